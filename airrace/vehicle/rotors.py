"""How rotors follow their commands, for the simulated ones and for predictions."""

from typing import NamedTuple

import numpy as np

from airrace.common.jit import compilable
from airrace.vehicle.vehicle import Vehicle


class RotorDynamics(NamedTuple):
    """First-order lag of the speeds of n rotors, advanced in steps of one period.

    Attributes:
        thrust_coefficients: c_f in thrust = c_f w^2 (N s^2), (n,).
        max_speeds: (rad/s), (n,).
        step_share: how much of a step in the command is made in one period, 0 to 1.
    """

    thrust_coefficients: np.ndarray
    max_speeds: np.ndarray
    step_share: float


def make_rotor_dynamics(vehicle: Vehicle, period: float) -> RotorDynamics:
    """Args: vehicle: the rotor table. period: of a step (s)."""
    step_share = float(1.0 - np.exp(-period / vehicle.rotor_lag))
    return RotorDynamics(vehicle.thrust_coefficients, vehicle.max_speeds, step_share)


@compilable
def next_speeds(speeds: np.ndarray, command: np.ndarray, rotors: RotorDynamics) -> np.ndarray:
    """Returns the speeds one period later (rad/s), (n,).

    Args:
        speeds: now (rad/s), (n,).
        command: (rad/s), (n,); negative ones and NaN count as zero.
        rotors: all of them.
    """
    result = np.empty(len(speeds))
    for i in range(len(speeds)):
        result[i] = next_speed(speeds[i], command[i], rotors.max_speeds[i], rotors.step_share)
    return result


@compilable
def next_speed(speed: float, command: float, max_speed: float, step_share: float) -> float:
    """Returns the speed of one rotor one period later; see next_speeds()."""
    target = min(command, max_speed) if command > 0.0 else 0.0
    return speed + step_share * (target - speed)


class RotorStatus(NamedTuple):
    """What the motor controllers report of n rotors, the vector ``rotor_status``, (1 + 2n,).

    Attributes:
        time: of the measurement (s).
        speeds: measured (rad/s), (n,).
        expected: of rotors that work, after the commands that arrived (rad/s), (n,).
    """

    time: float
    speeds: np.ndarray
    expected: np.ndarray


@compilable
def as_rotor_status(vector: np.ndarray) -> RotorStatus:
    """Returns the parts of a vector (1 + 2n,) as views of it."""
    n = len(vector) // 2
    return RotorStatus(vector[0], vector[1 : 1 + n], vector[1 + n :])
