"""The layout of the vectors in which a drone's motion crosses ports."""

from typing import NamedTuple

import numpy as np

from airrace.common.packing import Packing


class State(NamedTuple):
    """Time, pose and velocity of the body B in the world W, in Drake's monogram notation.

    The fields are numbers and arrays, each also for N samples at once. Compiled functions
    can make and read it.
    """

    time: float  #: s
    quaternion: np.ndarray  #: of R_WB, [w, x, y, z], (4,)
    position: np.ndarray  #: p_WB (m), (3,)
    angular_velocity: np.ndarray  #: w_WB, in the axes of W (rad/s), (3,)
    velocity: np.ndarray  #: v_WB, in the axes of W (m/s), (3,)


_SHAPES = {"quaternion": 4, "position": 3, "angular_velocity": 3, "velocity": 3}
# A state estimate, (14,).
_PACKING = Packing(State, **_SHAPES)
as_state, state_vector, STATE_SIZE = _PACKING.parts, _PACKING.vector, _PACKING.size
# Drake's floating-base state, (13,): all but the time.
as_plant_state = Packing(State, time=None, **_SHAPES).parts
