"""How long to wait for another computer or process: longer where one is slow.

``AIRRACE_PATIENCE=20`` multiplies every wait for the other side of a link, and for a companion, by
20. An emulated board needs that, a slow disk or a debugger may.
"""

import math
import os

from airrace.common.errors import UserError

VARIABLE = "AIRRACE_PATIENCE"


def patient(duration: float) -> float:
    """Returns how long to wait (s) for what should take a duration (s).

    Raises:
        UserError: if the variable is no number, or below 1.
    """
    text = os.environ.get(VARIABLE) or "1"
    try:
        factor = float(text)
    except ValueError:
        factor = math.nan
    if not 1.0 <= factor < math.inf:
        raise UserError(
            f"{VARIABLE}={text} must be a number of at least 1, such as 20: every wait for another "
            "computer or process is multiplied by it."
        )
    return factor * duration
