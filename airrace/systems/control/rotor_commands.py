"""From the thrusts that rotors should have to the speeds to command, for compiled functions."""

import math

import numpy as np

from airrace.common.jit import compilable, compiled
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
        command[i] = speed_command(
            thrusts[i],
            speeds[i],
            (max_thrusts[i], thrust_coefficients[i], max_speeds[i]),
            overdrive,
        )


@compilable
def speed_command(
    thrust: float, speed: float, rotor: tuple[float, float, float], overdrive: float
) -> float:
    """Returns the command (rad/s) of one rotor; see set_speeds().

    Args:
        thrust: it should have (N).
        speed: it has (rad/s).
        rotor: its greatest thrust (N), thrust coefficient (N s^2), and greatest speed (rad/s).
        overdrive: see there.
    """
    max_thrust, coefficient, max_speed = rotor
    desired = math.sqrt(thrust / coefficient)
    overdriven = speed + overdrive * (desired - speed)
    highest = max_speed if max_thrust > 0.0 else 0.0
    command = overdriven if overdriven < highest else highest
    return command if overdriven > 0.0 else 0.0  # NaN is not


def _step_share(rate: float, lag: float) -> float:
    """Returns how much of a step a first-order lag makes in one period."""
    return 1.0 - math.exp(-1.0 / (rate * lag))
