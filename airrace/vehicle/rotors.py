"""How rotors follow their commands, for the simulated ones and for predictions."""

from typing import NamedTuple

import numpy as np

from airrace.common.jit import compilable
from airrace.vehicle.vehicle import Vehicle


class RotorDynamics(NamedTuple):
    """First-order lag of the speeds of n rotors, advanced in steps of one period."""

    thrust_coefficients: np.ndarray  #: c_f in thrust = c_f w^2 (N s^2), (n,)
    max_speeds: np.ndarray  #: (rad/s), (n,)
    step_share: float  #: how much of a step in the command is made in one period, 0 to 1


def make_rotor_dynamics(vehicle: Vehicle, period: float) -> RotorDynamics:
    """Returns the rotors of a vehicle, advanced in steps of a period (s)."""
    step_share = float(1.0 - np.exp(-period / vehicle.rotor_lag))
    return RotorDynamics(vehicle.thrust_coefficients, vehicle.max_speeds, step_share)


@compilable
def next_speed(speed: float, command: float, max_speed: float, step_share: float) -> float:
    """Returns the speed of one rotor one period later (rad/s); see RotorDynamics.

    A command (rad/s) that is negative or NaN counts as zero.
    """
    target = min(command, max_speed) if command > 0.0 else 0.0
    return speed + step_share * (target - speed)


class RotorStatus(NamedTuple):
    """What the motor controllers report of n rotors, the vector ``rotor_status``, (1 + 2n,)."""

    time: float  #: of the measurement (s)
    speeds: np.ndarray  #: measured (rad/s), (n,)
    expected: np.ndarray  #: of rotors that work, after the commands that arrived (rad/s), (n,)


@compilable
def as_rotor_status(vector: np.ndarray) -> RotorStatus:
    """Returns the parts of a vector (1 + 2n,) as views of it."""
    n = len(vector) // 2
    return RotorStatus(vector[0], vector[1 : 1 + n], vector[1 + n :])
