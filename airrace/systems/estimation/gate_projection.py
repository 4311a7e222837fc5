"""Gates as landmarks: where the corners of their markers should appear in a picture.

The state of a gate is the vector of a GateState, (5,), see mapping/gate_filter.py.
"""

import math
from typing import NamedTuple

import numpy as np

from airrace.common.jit import compilable, compiled
from airrace.math.quaternion import rotation_matrix
from airrace.math.small_matrices import product, skew
from airrace.math.vec3 import rotate
from airrace.systems.estimation.navigation import Navigation
from airrace.systems.mapping.gate_filter import AT_GATE, GATE, as_gate, board_position, facing
from airrace.systems.perception.pose_refinement import project
from airrace.track import MARKER_SIZE

POSE = 6  # errors that a picture depends on: theta and dp
_LEAST_DEPTH = 0.1  # m, of a corner that a camera can show


class Camera(NamedTuple):
    """The camera, as it is mounted beside the inertial sensor."""

    intrinsics: np.ndarray  #: fx, fy, cx, cy, k1, k2, p1, p2, k3, (9,)
    R_CB: np.ndarray  #: rotation from the body to the camera, (3, 3)
    p_IC: np.ndarray  #: from the sensor to the camera, in axes of the body (m), (3,)


@compiled
def corner_positions(gate: np.ndarray, id: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns the corners of a marker in the world, and their derivatives by the gate.

    Args: gate: its state, (5,). id: of the marker.

    Returns:
        top left, top right, bottom right, bottom left as the marker is read, (4, 3) m; and
        (4, 3, 5).
    """
    p_WM, by_gate = board_position(gate, id)
    heading = as_gate(gate).heading
    c, s = math.cos(heading), math.sin(heading)
    # To the right of who looks at the face: of a back face, he looks against the heading.
    right = -facing(id) * 0.5 * MARKER_SIZE
    corners, derivatives = np.empty((4, 3)), np.empty((4, 3, GATE))
    for k in range(4):
        along = right if k == 1 or k == 2 else -right
        up = 0.5 * MARKER_SIZE if k < 2 else -0.5 * MARKER_SIZE
        corners[k, 0], corners[k, 1] = p_WM[0] + along * s, p_WM[1] - along * c
        corners[k, 2] = p_WM[2] + up
        derivatives[k] = by_gate
        derivatives[k, 0, AT_GATE.heading] += along * c
        derivatives[k, 1, AT_GATE.heading] += along * s
    return corners, derivatives


@compilable
def predicted_corners(
    state: Navigation, gate: np.ndarray, id: int, camera: Camera
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Returns where a marker's corners should be, and how that depends on drone and gate.

    Of a point P, p_CP = R_CB (R_WB^T (p_WP - p_WI) - p_IC). With the error theta of the
    attitude, R_WB^T d becomes R_WB^T d + (R_WB^T d) x theta.

    Args:
        state: of the drone when the picture was taken.
        gate: its state, (5,).
        id: of the marker.
        camera: see Camera.

    Returns:
        pixels, (8,); their derivatives by (theta, dp), (8, 6), and by the gate's state, (8, 5);
        and the least depth of a corner (m): if that is not positive, the rest has no meaning.
    """
    R_BW = rotation_matrix(state.quaternion).T
    corners, by_gate = corner_positions(gate, id)
    pixels, by_pose, by_state = np.empty(8), np.empty((8, POSE)), np.empty((8, GATE))
    nearest = np.inf
    for k in range(4):
        p_B = rotate(R_BW, corners[k] - state.position)
        p_C = rotate(camera.R_CB, p_B - camera.p_IC)
        nearest = min(nearest, p_C[2])
        if p_C[2] < _LEAST_DEPTH:
            nearest = -1.0
            p_C[2] = _LEAST_DEPTH
        rows = slice(2 * k, 2 * k + 2)
        pixels[rows], by_camera = project(p_C, camera.intrinsics)
        by_body = product(by_camera, camera.R_CB)
        by_position = product(by_body, R_BW)
        by_pose[rows, :3], by_pose[rows, 3:] = product(by_body, skew(p_B)), -by_position
        by_state[rows] = product(by_position, by_gate[k])
    return pixels, by_pose, by_state, nearest
