"""From the wrench that a controller wants to the rates that a flight controller is told."""

import numpy as np

from airrace.common.jit import compiled
from airrace.math.triples import cross, rotate_back, rotation_rows, times
from airrace.vehicle.state import as_state


@compiled
def set_rates(
    command: np.ndarray,
    wrench: np.ndarray,
    estimate: np.ndarray,
    inertia: np.ndarray,
    gains: np.ndarray,
) -> None:
    """Sets total thrust (N) and rates in B (rad/s), [f, w_x, w_y, w_z], (4,).

    They are those at which a rate loop, M = J K (w_d - w) + w x J w, asks for just the wanted
    moment: w_d = w + K^-1 J^-1 (M - w x J w). With the controller's own gains on the angular
    velocity as K, w no longer counts in lee_wrench()'s law: what is left are the desired rates, and
    to those the error in attitude and the desired acceleration, each over K.

    Args:
        command: is written.
        wrench: [f, Mx, My, Mz], thrust (N) and moments in B (N m), (4,).
        estimate: vector of a State, (14,), of which attitude and angular velocity are used.
        inertia: principal moments in B (kg m^2), (3,).
        gains: K, of the rate loop (1/s), (3,).
    """
    state = as_state(estimate)
    w = rotate_back(rotation_rows(state.quaternion), state.angular_velocity)
    spin = cross(w, times(inertia, w))
    command[0] = wrench[0]
    for i in range(3):
        command[1 + i] = w[i] + (wrench[1 + i] - spin[i]) / (inertia[i] * gains[i])
