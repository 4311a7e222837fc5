"""When an estimate is too uncertain to be flown by."""

import numpy as np

from airrace.systems.estimation.error_state import as_drone_error
from airrace.systems.estimation.kalman_update import Belief, relative_covariance
from airrace.systems.estimation.slam_state import SlamState
from airrace.systems.mapping.gate_filter import as_gate

# Standard deviations. A gate is 10 m wide: with more than the first, one flight through a gate in
# three would be beside it. With more than the second, the drone cannot even come to rest.
_MOST_POSITION, _MOST_VELOCITY, _MOST_ATTITUDE = 5.0, 2.0, 15.0  # m, m/s, degrees
_MOST_SILENCE = 0.2  # s, without a sample of the inertial sensor
_MOST_REFUSED = 90  # pictures in a row of which every known marker was refused


def why_lost(state: SlamState, imu_silence: float) -> str:
    """Returns why a drone in flight cannot go by its estimate any more, empty if it can.

    Args:
        state: of the filter.
        imu_silence: time since the newest sound sample of the inertial sensor (s).
    """
    if state.at_rest:
        return ""
    if state.time < 0.0:
        return "the attitude was not known at take-off"
    if imu_silence > _MOST_SILENCE:
        return "the IMU fell silent"
    position, velocity, attitude = _worst_sigmas(state.belief)
    if not np.isfinite(position):
        return "the estimate is not finite"
    if state.refused_in_a_row >= _MOST_REFUSED:
        return f"no marker was where it should be in {state.refused_in_a_row} pictures"
    for what, sigma, most, words in (
        ("position", position, _MOST_POSITION, "{:.1f} m"),
        ("velocity", velocity, _MOST_VELOCITY, "{:.1f} m/s"),
        ("attitude", np.rad2deg(attitude), _MOST_ATTITUDE, "{:.0f} degrees"),
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
    return float(_worst_sigmas(belief)[0])


def _worst_sigmas(belief):
    """Returns drift_sigma(), and those of velocity (m/s) and attitude (rad), (3,).

    They are NaN if anything in the belief is not finite.
    """
    P = belief.covariance
    if not (np.isfinite(belief.navigation).all() and np.isfinite(P).all()):
        return np.full(3, np.nan)
    variances = as_drone_error(np.diag(P))
    to_gates = (
        as_gate(np.diag(relative_covariance(belief, gate))).p_WG.max()
        for gate in range(len(belief.gates))
    )
    position = min(to_gates, default=variances.position.max())
    return np.sqrt([position, variances.velocity.max(), variances.theta.max()])
