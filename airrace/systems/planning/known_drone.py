"""What plans count with, of rotors and air: what was learnt in flight, and what is yet to be."""

import dataclasses as dc

import numpy as np

from airrace.trajopt.flight_limits import FlightLimits
from airrace.vehicle import Vehicle
from airrace.vehicle.air import Air, air_vector, as_air

# Of the rotors' factors, and of an Air, so that a plan stays the same for a while.
_STEP, _AIR_STEPS = 0.005, air_vector(Air(0.01, 0.0005, np.full(3, 0.5), 0.01, 0.0005))
_ROUNDING = 1e-12  # of a step
# Of the rotors' thrust, that is kept: for factors that differ by one; for gusts; and for the drag
# in the drone's file, if it may be there or not.
_UNEQUAL, _GUSTS, _UNKNOWN = 0.1, 0.03, 0.3


def in_steps(factors: np.ndarray, air: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns rotors and air as plans count with them: thrusts are not rounded up.

    Args: factors: see RotorLearner, (n,). air: vector of an Air, (7,).
    """
    return (_STEP * np.floor(factors / _STEP + _ROUNDING), _AIR_STEPS * np.round(air / _AIR_STEPS))


def expecting_drag(
    factors: np.ndarray, vehicle: Vehicle, share: float
) -> tuple[np.ndarray, np.ndarray]:
    """Returns rotors' factors, (n,), and air, (7,), for a drone that has yet to meet any drag.

    Args: factors: so far. vehicle: of the drag in its file. share: of that drag, which is counted
    with; thrust for as much again is kept.
    """
    linear, quadratic = (
        np.array([(each[0] + each[1]) / 2.0, each[2]]) * share / vehicle.mass
        for each in (vehicle.drag.linear, vehicle.drag.quadratic)
    )
    air = Air(linear[0], quadratic[0], np.zeros(3), np.diff(linear)[0], np.diff(quadratic)[0])
    return (1.0 - _UNKNOWN * share) * factors, air_vector(air)


def known_limits(limits: FlightLimits, factors: np.ndarray, air: np.ndarray) -> FlightLimits:
    """Returns the limits of a drone in the air, both as they are known by now.

    Where rotors are unequal, the weakest is at its limit alone, and what it lacks is always yaw of
    the same sign: some thrust is kept for that. Where there is wind, there are gusts.

    Args: limits: as in the drone's file. factors, air: see in_steps().
    """
    known = as_air(air)
    gusts = 0.0 if known.is_still else _GUSTS
    reserve = _UNEQUAL * float(np.ptp(factors)) + gusts
    return dc.replace(
        limits,
        vehicle=limits.vehicle.with_thrusts(factors),
        thrust_share=limits.thrust_share * (1.0 - reserve),
        air=known,
    )
