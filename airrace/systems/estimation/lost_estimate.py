"""When an estimate is too uncertain to be flown by."""

from typing import TYPE_CHECKING

import numpy as np

from airrace.systems.estimation.error_state import POSITION, THETA, VELOCITY
from airrace.systems.estimation.kalman_update import Belief, relative_covariances

if TYPE_CHECKING:
    from airrace.systems.estimation.slam_filter import SlamState

# Standard deviations. A gate is 10 m wide: with more than the first, one flight through a gate in
# three would be beside it. With more than the second, the drone cannot even come to rest.
_MOST_POSITION, _MOST_VELOCITY, _MOST_ATTITUDE = 5.0, 2.0, 15.0  # m, m/s, degrees
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
    for what, sigma, most, words in (
        ("position", drift_sigma(belief), _MOST_POSITION, "{:.1f} m"),
        ("velocity", _worst_sigma(belief, VELOCITY), _MOST_VELOCITY, "{:.1f} m/s"),
        ("attitude", np.rad2deg(_worst_sigma(belief, THETA)), _MOST_ATTITUDE, "{:.0f} degrees"),
    ):
        if sigma > most:
            seen = max((each.seen_at for each in state.landmarks), default=-1.0)
            since = f" after {state.time - seen:.1f} s without a marker" if seen >= 0.0 else ""
            return f"{what} uncertain by {words.format(sigma)}{since}"
    return ""


def drift_sigma(belief: Belief) -> float:
    """Returns how uncertain the drone's position is, to the gate to which it is least (m).

    That is the greatest standard deviation of x, y and z of p_WG - p_WI in the drone's heading;
    without any gate, of p_WI.
    """
    if not len(belief.gates):
        return _worst_sigma(belief, POSITION)
    variances = np.diagonal(relative_covariances(belief), axis1=1, axis2=2)[:, :3]
    return float(np.sqrt(np.min(np.max(variances, axis=1))))


def _worst_sigma(belief: Belief, at: int) -> float:
    return float(np.sqrt(np.max(np.diagonal(belief.covariance)[at : at + 3])))
