"""The layout of the vectors in which a drone's motion crosses ports."""

from typing import NamedTuple

import numpy as np

from airrace.common.jit import compilable

STATE_SIZE = 14  # of a vector: the time, then Drake's floating-base state (13)


class State(NamedTuple):
    """Time, pose and velocity of the body B in the world W, in Drake's monogram notation.

    The fields are numbers and arrays, each also for N samples at once. Compiled functions
    can make and read it.

    Attributes:
        time: (s).
        quaternion: of R_WB, [w, x, y, z], (4,).
        position: p_WB (m), (3,).
        angular_velocity: w_WB, in the axes of W (rad/s), (3,).
        velocity: v_WB, in the axes of W (m/s), (3,).
    """

    time: float
    quaternion: np.ndarray
    position: np.ndarray
    angular_velocity: np.ndarray
    velocity: np.ndarray


@compilable
def as_state(vector: np.ndarray) -> State:
    """Returns the parts of a state estimate, (14,), or of N, (14, N), as views of it."""
    return as_plant_state(vector[1:], vector[0])


@compilable
def as_plant_state(vector: np.ndarray, time: float = np.nan) -> State:
    """Returns the parts of Drake's floating-base state, (13,) or (13, N), as views of it."""
    return State(time, vector[0:4], vector[4:7], vector[7:10], vector[10:13])


@compilable
def state_vector(state: State) -> np.ndarray:
    """Returns the vector of a state, (14,)."""
    time, quaternion, position, angular_velocity, velocity = state
    return np.concatenate((np.array((time,)), quaternion, position, angular_velocity, velocity))
