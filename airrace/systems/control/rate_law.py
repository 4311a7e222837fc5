"""The law of the rate controller: from thrust and body rates to rotor speeds, as one function."""

from typing import NamedTuple

import numpy as np

from airrace.common.jit import all_finite, compilable, compiled
from airrace.math.triples import Triple, added, cross, difference, rotate_back, rotation_rows, times
from airrace.systems.control.rotor_commands import overdrive_of, set_speeds
from airrace.vehicle import Vehicle
from airrace.vehicle.state import as_state

# 1/s. With the rotors' apparent lag of 0.01 s the loop is s (0.01 s + 1) + 50: damped by 0.7.
_RATE_GAIN = 50.0
# About z the rotors have so little moment that they are at their limits for most of a step.
_YAW_GAIN = 15.0
_LITTLE = 1e-9  # N, too little to limit


class RateParameters(NamedTuple):
    """The vehicle as rate_law() takes it, for n rotors."""

    gains: np.ndarray  #: on errors of the rates about x, y, z (1/s), (3,)
    inertia: np.ndarray  #: principal moments in B (kg m^2), (3,)
    #: From [f, Mx, My, Mz] to the thrusts: pseudo-inverse of Vehicle.allocation, (n, 4).
    inverse: np.ndarray
    max_thrusts: np.ndarray  #: (N), (n,)
    thrust_coefficients: np.ndarray  #: (N s^2), (n,)
    max_speeds: np.ndarray  #: (rad/s), (n,)
    overdrive: float  #: factor on changes of a rotor's speed, see set_speeds()


def make_rate_parameters(vehicle: Vehicle, rate: float) -> RateParameters:
    """Args: vehicle: as its file says. rate: of the controller (Hz)."""
    return RateParameters(
        gains=np.array((_RATE_GAIN, _RATE_GAIN, _YAW_GAIN)),
        inertia=np.array(vehicle.inertia, float),
        inverse=np.ascontiguousarray(np.linalg.pinv(vehicle.allocation)),
        max_thrusts=vehicle.max_thrusts,
        thrust_coefficients=vehicle.thrust_coefficients,
        max_speeds=vehicle.max_speeds,
        overdrive=overdrive_of(vehicle, rate),
    )


@compiled
def rate_law(
    command: np.ndarray,
    wanted: np.ndarray,
    estimate: np.ndarray,
    speeds: np.ndarray,
    parameters: tuple,
) -> None:
    """Sets the rotor speeds to command (rad/s), (n,), unless an argument is not finite.

    The moment is M = J K (w_d - w) + w x J w: proportional in the error of the rates, and what
    turns the spin itself. There is no integral: an error that stays is for whoever sets the
    rates, and nothing can wind up. Where a rotor is at its limit, set_limited_thrusts() says
    what is given up.

    Args:
        command: is written.
        wanted: [f, w_x, w_y, w_z]: total thrust (N) and w_d, the rates in B (rad/s), (4,).
        estimate: vector of a State, (14,), of which attitude and angular velocity are used.
        speeds: of the rotors, as they are (rad/s), (n,).
        parameters: RateParameters as a tuple, which is quicker to hand over.
    """
    if not (all_finite(wanted) and all_finite(estimate)):
        return
    p, f, state = RateParameters(*parameters), wanted[0], as_state(estimate)
    w = rotate_back(rotation_rows(state.quaternion), state.angular_velocity)
    moment = wanted_moment(wanted[1:], w, p.inertia, p.gains)
    # The command is a place for the thrusts until it is written: new arrays take time.
    possible = True
    for i in range(len(command)):
        command[i] = unlimited_thrust(p.inverse[i], f, moment)
        possible = possible and 0.0 <= command[i] <= p.max_thrusts[i]
    if not possible:
        set_limited_thrusts(command, f, moment, p.inverse, p.max_thrusts)
    rotors = p.max_thrusts, p.thrust_coefficients, p.max_speeds
    set_speeds(command, command, speeds, *rotors, p.overdrive)


@compilable
def wanted_moment(w_d: Triple, w: Triple, inertia: Triple, gains: Triple) -> Triple:
    """Returns the moment of rate_law() in B (N m).

    Args:
        w_d: rates to have, in B (rad/s). w: that the body has.
        inertia, gains: see RateParameters.
    """
    error = times(times(inertia, gains), difference(w_d, w))
    return added(error, 1.0, cross(w, times(inertia, w)))


@compilable
def unlimited_thrust(row: tuple[float, float, float, float], f: float, moment: Triple) -> float:
    """Returns what a rotor should give (N), if it has no limits.

    Args: row: of inverse, see RateParameters. f: total thrust (N). moment: (N m).
    """
    return row[0] * f + (row[1] * moment[0] + row[2] * moment[1]) + row[3] * moment[2]


@compiled
def set_limited_thrusts(
    thrusts: np.ndarray, f: float, moment: Triple, inverse: np.ndarray, limits: np.ndarray
) -> None:
    """Sets thrusts (N), (n,), for a total thrust (N) and a moment in B (N m), (3,).

    Beyond the limits, the moment about z is given up first, then the thrust, and roll and pitch,
    which point the thrust, last: the priorities of Faessler, Falanga and Scaramuzza, "Thrust
    mixing, saturation, and body-rate control for accurate aggressive quadrotor flight" (RA-L
    2017), section III. Each is scaled as little as brings all rotors within their limits, which
    needs no iteration.

    Args: thrusts: are written. inverse: (n, 4), whose first column is positive. limits: (N), (n,).
    """
    n = len(limits)
    # Of roll and pitch, as much as some total thrust allows: each rotor needs some total thrust
    # at least, not to be below zero, and allows some at most.
    lowest = np.inf
    for i in range(n):
        thrusts[i] = (inverse[i, 1] * moment[0] + inverse[i, 2] * moment[1]) / inverse[i, 0]
        lowest = min(lowest, thrusts[i])
    share = 1.0
    for i in range(n):
        apart, room = thrusts[i] - lowest, limits[i] / inverse[i, 0]
        if share * apart > room:
            share = room / apart
    # The total thrust nearest to that wanted.
    low, high = -np.inf, np.inf
    for i in range(n):
        low = max(low, -share * thrusts[i])
        high = min(high, limits[i] / inverse[i, 0] - share * thrusts[i])
    f = min(max(f, low), high)
    # Of yaw, what is left.
    yaw_share = 1.0
    for i in range(n):
        thrusts[i] = inverse[i, 0] * (f + share * thrusts[i])
        turning = inverse[i, 3] * moment[2]
        if turning > _LITTLE:
            yaw_share = min(yaw_share, max(limits[i] - thrusts[i], 0.0) / turning)
        elif turning < -_LITTLE:
            yaw_share = min(yaw_share, max(thrusts[i], 0.0) / -turning)
    for i in range(n):
        thrust = thrusts[i] + yaw_share * inverse[i, 3] * moment[2]
        thrusts[i] = min(max(thrust, 0.0), limits[i])  # but for rounding, it is within
