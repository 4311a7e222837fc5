"""What a policy sees of the race: its own motion, and the next gates from where it is."""

import math

import numpy as np

from airrace.common.jit import compilable
from airrace.math.quaternion import rotation_matrix
from airrace.math.vec3 import rotate
from airrace.track.track import BOARD_HEIGHT, PYLON_HEIGHT
from airrace.vehicle.state import State

MOTION_SIZE = 15  # v_B (3), R_WB (9), w_B (3)
GATE_SIZE = 12  # four corners


def observation_size(gates: int, actions: int) -> int:
    """Returns the length of an observation of so many next gates, with so many last actions."""
    return MOTION_SIZE + GATE_SIZE * gates + actions


def opening_numbers(p_WG: np.ndarray, heading: float, spacing: float) -> np.ndarray:
    """Returns the numbers of a gate's opening, (10,), as those of track.gate_opening.GateOpening.

    Args:
        p_WG: midpoint at the boards' height, (3,) m. heading: of flight through it (rad).
        spacing: of the pylon axes (m).
    """
    c, s = math.cos(heading), math.sin(heading)
    return np.array((*p_WG, c, s, 0.0, s, -c, 0.0, spacing / 2))


@compilable
def write_gates_observation(
    observation: np.ndarray,
    state: State,
    gates: np.ndarray,
    next_gate: int,
    last_action: np.ndarray,
) -> None:
    """Writes the observation ``gates`` of one drone.

    It is, in this order: v_B (3, m/s), R_WB (9, row by row), w_B (3, rad/s); of each of the next
    N gates the corners of its opening, from the body's origin and in its axes (N x 4 x 3, m):
    left bottom, right bottom, right top, left top, as seen flying through; and the action
    before. N follows from the length.

    The opening is the rectangle in which a gate counts, see GateOpening: from one pylon axis to
    the other, from the ground to the pylons' tips. A gate's numbers hold its midpoint at the
    height of the boards, so that the ground is BOARD_HEIGHT below it.

    Args:
        observation: is written, (15 + 12 N + m,), of floats of any size.
        state: of the body, see vehicle/state.py.
        gates: numbers of the openings in the order of flight, (n, 10), see GateOpening.
        next_gate: index of the gate to fly through next; it is counted on round by round.
        last_action: (m,).
    """
    R_WB = rotation_matrix(state.quaternion)
    R_BW = R_WB.T
    v_B, w_B = rotate(R_BW, state.velocity), rotate(R_BW, state.angular_velocity)
    for i in range(3):
        observation[i] = v_B[i]
        for j in range(3):
            observation[3 + 3 * i + j] = R_WB[i, j]
        observation[12 + i] = w_B[i]
    count = (len(observation) - MOTION_SIZE - len(last_action)) // GATE_SIZE
    k = MOTION_SIZE
    for i in range(count):
        x, y, z, _, _, _, right_x, right_y, _, half = gates[(next_gate + i) % len(gates)]
        bottom = z - BOARD_HEIGHT - state.position[2]
        top = bottom + PYLON_HEIGHT
        for side, height in ((-half, bottom), (half, bottom), (half, top), (-half, top)):
            p_W = np.array(
                (
                    x + side * right_x - state.position[0],
                    y + side * right_y - state.position[1],
                    height,
                )
            )
            p_B = rotate(R_BW, p_W)
            observation[k], observation[k + 1], observation[k + 2] = p_B[0], p_B[1], p_B[2]
            k += 3
    for i in range(len(last_action)):
        observation[k + i] = last_action[i]
