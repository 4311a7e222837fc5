"""What a discrete plant shows between its steps."""

import math


def lead(time: float, period: float) -> float:
    """Returns by how much the state that a discrete plant shows at a time is ahead of it (s).

    Between its steps a plant shows the state at the end of the step; at the time of a step,
    to those who look before it is made, the one of that time.

    Args:
        time: at which somebody looks (s).
        period: of the plant's steps (s); 0 if its state is continuous.
    """
    return math.ceil(time / period - 1e-6) * period - time if period > 0.0 else 0.0
