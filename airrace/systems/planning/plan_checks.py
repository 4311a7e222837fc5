"""Whether a plan of a function of one's own can be flown at all."""

import numpy as np

from airrace.systems.contract import check_value, refuse
from airrace.systems.planning.lap_plan import LapPlan

_WANTED = "a LapPlan (see airrace/systems/planning/lap_plan.py), or None if it finds nothing"
_SAMPLES = 100  # of entry and circuit each


def check_plan(who: str, plan: LapPlan) -> None:
    """Checks the kind of a plan, and that it is finite.

    Args: who: returned it.

    Raises:
        UserError: naming who gave what, and what is wanted.
    """
    if not isinstance(plan, LapPlan):
        refuse(who, plan, _WANTED)
    check_value(who, plan, LapPlan)
    end = plan.start_time + plan.entry.duration
    times = [
        *np.linspace(plan.start_time, end, _SAMPLES),
        *np.linspace(end, end + plan.circuit.duration, _SAMPLES),
    ]
    flown = np.array([plan.derivatives(time) for time in times])
    if not np.isfinite(flown).all():
        refuse(who, plan, "a LapPlan whose entry and circuit are finite at all times")
