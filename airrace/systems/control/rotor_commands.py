"""From the thrusts that rotors should have to the speeds to command, for compiled functions."""

import math

import numpy as np

from airrace.common.jit import compiled
from airrace.vehicle import Vehicle

_SHORT_LAG = 0.01  # s, the rotors' apparent lag under overdriven commands


def overdrive_of(vehicle: Vehicle, rate: float) -> float:
    """Returns the factor on changes of speed by which commands overshoot; see set_speeds().

    With it, rotors answer as if their lag were 0.01 s, unless it is less.

    Args: vehicle: of the rotors. rate: of the commands (Hz).
    """
    lag = vehicle.rotor_lag
    return _step_share(rate, min(_SHORT_LAG, lag)) / _step_share(rate, lag)


@compiled
def set_speeds(
    command: np.ndarray,
    thrusts: np.ndarray,
    speeds: np.ndarray,
    max_thrusts: np.ndarray,
    thrust_coefficients: np.ndarray,
    max_speeds: np.ndarray,
    overdrive: float,
) -> None:
    """Sets the speeds to command (rad/s), (n,), for thrusts (N), (n,).

    Rotors answer late, so that the command goes beyond the speed that they should have:
    overdrive is a factor on the change of speed, 1 for that speed itself. Rotors that are
    lost, or report no speed, are not driven.
    """
    for i in range(len(command)):
        desired = math.sqrt(thrusts[i] / thrust_coefficients[i])
        overdriven = speeds[i] + overdrive * (desired - speeds[i])
        works = max_thrusts[i] > 0.0 and overdriven > 0.0  # NaN is not
        command[i] = min(overdriven, max_speeds[i]) if works else 0.0


def _step_share(rate: float, lag: float) -> float:
    """Returns how much of a step a first-order lag makes in one period."""
    return 1.0 - math.exp(-1.0 / (rate * lag))
