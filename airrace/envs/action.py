"""The actions of the environments: numbers from -1 to 1, and what they stand for.

- ``ctbr`` (4): total thrust, from none to all that the rotors have, and the rates of the body about
  x, y and z, up to MAX_RATES either way. The rate controller holds its command for one of its
  periods, as every controller does: what it computes at a tick reaches the rotors at the next.
- ``rotors`` (n): the speed of each rotor, from standing still to its greatest. The command reaches
  the rotors at their next tick, 0.002 s.
- ``reference`` (7): position from where the drone is at the time of the action, velocity, both in
  the world, and yaw, for the geometric controller.
"""

import numpy as np

from airrace.common.errors import UserError
from airrace.systems.policy.command_scale import CommandScale, ctbr_scale, make_scale
from airrace.vehicle import Vehicle

KINDS = ("ctbr", "rotors", "reference")
REFERENCE_REACH = 5.0  # m, of a position along each axis of the world
REFERENCE_SPEED = 20.0  # m/s, along each axis


def action_scale(kind: str, vehicle: Vehicle) -> CommandScale:
    """Returns what the actions of a kind stand for; its length is that of an action.

    ``ctbr``: N and rad/s; ``rotors``: rad/s; ``reference``: m, m/s and rad.

    Raises:
        UserError: if there is no such kind.
    """
    if kind == "ctbr":
        return ctbr_scale(vehicle)
    if kind == "rotors":
        return make_scale(np.zeros(len(vehicle.rotors)), vehicle.max_speeds)
    if kind == "reference":
        reach = np.array([*3 * [REFERENCE_REACH], *3 * [REFERENCE_SPEED], np.pi])
        return make_scale(-reach, reach)
    raise UserError(f"action must be one of {', '.join(KINDS)}, not '{kind}'.")


def check_action(action: object, shape: tuple[int, ...]) -> np.ndarray:
    """Returns an action, or those of many drones, as an array of float64 of a shape.

    Raises:
        ValueError: if it has another shape, or a number that is not finite.
    """
    try:
        result = np.asarray(action, float, order="C")
    except (OverflowError, TypeError, ValueError):
        raise ValueError(
            f"The action must be an array of numbers from -1 to 1, not {action!r}."
        ) from None
    if result.shape != shape:
        raise ValueError(f"The action must have the shape {shape}, not {result.shape}: {action}.")
    for index in np.argwhere(~np.isfinite(result)):
        whose = "".join(f" of drone {drone}" for drone in index[:-1])
        raise ValueError(
            f"The action must be finite numbers from -1 to 1, but that{whose} is "
            f"{result[tuple(index[:-1])]}."
        )
    return result
