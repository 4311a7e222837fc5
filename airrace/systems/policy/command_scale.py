"""How the numbers of a policy, -1 to 1, become commands: thrust and body rates."""

from typing import NamedTuple

import numpy as np

from airrace.vehicle import Vehicle

# rad/s, about x, y, z. Roll and pitch: racing turns need 5 to 8, and rotors reach 10 in about
# 0.05 s. Yaw: the rotors' drag gives 3 to 9 rad/s^2, so that more than 2 would take a second.
MAX_RATES = (10.0, 10.0, 2.0)


class CommandScale(NamedTuple):
    """What the numbers of an action stand for: command = center + half_range * action."""

    center: np.ndarray  #: the command of an action of zeros, (m,)
    half_range: np.ndarray  #: from there to the command of ones, (m,)


def make_scale(low: np.ndarray, high: np.ndarray) -> CommandScale:
    """Returns the scale on which -1 is ``low`` and 1 is ``high``, (m,) each."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    return CommandScale((low + high) / 2, (high - low) / 2)


def ctbr_scale(vehicle: Vehicle) -> CommandScale:
    """Returns the scale of collective thrust and body rates, [f, w_x, w_y, w_z], (4,).

    The thrust (N) goes from none to all that the rotors have; the rates (rad/s), in the axes
    of the body, to MAX_RATES either way.
    """
    rates = np.array(MAX_RATES)
    return make_scale(np.append(0.0, -rates), np.append(vehicle.max_thrusts.sum(), rates))


def scaled(action: np.ndarray, scale: CommandScale) -> np.ndarray:
    """Returns the command of an action, (m,); what is beyond -1 or 1 counts as that."""
    return scale.center + scale.half_range * np.clip(np.asarray(action, float), -1.0, 1.0)


def unscaled(command: np.ndarray, scale: CommandScale) -> np.ndarray:
    """Returns the action of a command, (m,), not clipped."""
    return (command - scale.center) / scale.half_range
