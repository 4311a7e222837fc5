"""When an estimate is too uncertain to be flown by."""

from typing import TYPE_CHECKING

import numpy as np

from airrace.systems.estimation.error_state import POSITION, THETA, VELOCITY
from airrace.systems.estimation.kalman_update import Belief, relative_covariance

if TYPE_CHECKING:
    from airrace.systems.estimation.slam_filter import SlamState

# Standard deviations. A gate is 10 m wide: with more than the first, one flight through a gate in
# three would be beside it. With more than the second, the drone cannot even come to rest.
_MOST_POSITION, _MOST_VELOCITY, _MOST_ATTITUDE = 5.0, 2.0, np.deg2rad(15.0)  # m, m/s, rad
_MOST_SILENCE = 0.2  # s, without a sample of the inertial sensor
_MOST_REFUSED = 90  # pictures in a row of which every known marker was refused


def why_lost(state: "SlamState", imu_silence: float) -> str:
    """Returns why a drone in flight cannot go by its estimate any more, empty if it can.

    Args:
        state: of the filter.
        imu_silence: time since the newest sound sample of the inertial sensor (s).
    """
    belief = state.belief
    if state.at_rest:
        return ""
    if state.time < 0.0:
        return "the attitude was not known at take-off"
    if imu_silence > _MOST_SILENCE:
        return "the IMU fell silent"
    if not (np.isfinite(belief.navigation).all() and np.isfinite(belief.covariance).all()):
        return "the estimate is not finite"
    if state.refused_in_a_row >= _MOST_REFUSED:
        return f"no marker was where it should be in {state.refused_in_a_row} pictures"
    attitude, velocity = (_worst_sigma(belief, at) for at in (THETA, VELOCITY))
    position = drift_sigma(belief)
    for what, sigma, most, amount in (
        ("position", position, _MOST_POSITION, f"{position:.1f} m"),
        ("velocity", velocity, _MOST_VELOCITY, f"{velocity:.1f} m/s"),
        ("attitude", attitude, _MOST_ATTITUDE, f"{np.rad2deg(attitude):.0f} degrees"),
    ):
        if sigma > most:
            seen = max((each.seen_at for each in state.landmarks), default=-1.0)
            since = f" after {state.time - seen:.1f} s without a marker" if seen >= 0.0 else ""
            return f"{what} uncertain by {amount}{since}"
    return ""


def drift_sigma(belief: Belief) -> float:
    """Returns how uncertain the drone's position is, to the gate to which it is least (m).

    That is the greatest standard deviation of x, y and z of p_WG - p_WI in the drone's heading;
    without any gate, of p_WI.
    """
    own = np.diag(belief.covariance)[POSITION:VELOCITY]
    worst = [
        np.max(np.diag(relative_covariance(belief, gate))[:3]) for gate in range(len(belief.gates))
    ]
    return float(np.sqrt(min(worst, default=np.max(own))))


def _worst_sigma(belief: Belief, at: int) -> float:
    return float(np.sqrt(np.max(np.diag(belief.covariance)[at : at + 3])))
