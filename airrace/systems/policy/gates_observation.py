"""What a policy sees of the race: its own motion, and the next gates from where it is."""

import math
from collections.abc import Iterable

import numpy as np

from airrace.common.jit import compilable
from airrace.math.triples import rotate_back, rotation_rows
from airrace.track.course import Opening
from airrace.track.gate_map import GateEstimate
from airrace.track.gate_opening import OPENING_SIZE
from airrace.track.track import BOARD_HEIGHT, PYLON_HEIGHT
from airrace.vehicle.state import State

MOTION_SIZE = 15  # v_B (3), R_WB (9), w_B (3)
GATE_SIZE = 12  # four corners


def observation_size(gates: int, actions: int) -> int:
    """Returns the length of an observation of so many next gates, with so many last actions."""
    return MOTION_SIZE + GATE_SIZE * gates + actions


def opening_numbers(p_WG: np.ndarray, heading: float, spacing: float) -> np.ndarray:
    """Returns the numbers of a gate's opening, (15,), see track.course.Opening.

    Args:
        p_WG: midpoint at the boards' height, (3,) m. heading: of flight through it (rad).
        spacing: of the pylon axes (m).
    """
    c, s = math.cos(heading), math.sin(heading)
    return np.hstack(
        Opening(
            middle=p_WG,
            forward=np.array([c, s, 0.0]),
            rightward=np.array([s, -c, 0.0]),
            half_width=spacing / 2,
            up=np.array([0.0, 0.0, 1.0]),
            low=-BOARD_HEIGHT,
            high=PYLON_HEIGHT - BOARD_HEIGHT,
        )
    )


def map_openings(gates: Iterable[GateEstimate]) -> np.ndarray:
    """Returns the openings of a map's gates, (n, 15); n is 0 if there are none."""
    numbers = [opening_numbers(g.p_WG, g.heading, g.spacing) for g in gates]
    return np.array(numbers).reshape(-1, OPENING_SIZE)


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

    The opening is the rectangle in which a gate counts, see Opening: from one pylon axis to
    the other, from the ground to the pylons' tips. A gate's numbers hold its midpoint at the
    height of the boards, so that the ground is BOARD_HEIGHT below it.

    Args:
        observation: is written, (15 + 12 N + m,), of floats of any size.
        state: of the body, see vehicle/state.py.
        gates: numbers of the openings in the order of flight, (n, 15), see Opening.
        next_gate: index of the gate to fly through next; it is counted on round by round.
        last_action: (m,).
    """
    q, p, w, v = state.quaternion, state.position, state.angular_velocity, state.velocity
    R_WB = rotation_rows((q[0], q[1], q[2], q[3]))
    v_B, w_B = rotate_back(R_WB, (v[0], v[1], v[2])), rotate_back(R_WB, (w[0], w[1], w[2]))
    observation[0], observation[1], observation[2] = v_B
    observation[3], observation[4], observation[5] = R_WB[0]
    observation[6], observation[7], observation[8] = R_WB[1]
    observation[9], observation[10], observation[11] = R_WB[2]
    observation[12], observation[13], observation[14] = w_B
    count = (len(observation) - MOTION_SIZE - len(last_action)) // GATE_SIZE
    k = MOTION_SIZE
    for i in range(count):
        gate = (next_gate + i) % len(gates)
        x, y, bottom = gates[gate, 0] - p[0], gates[gate, 1] - p[1], gates[gate, 2] - p[2]
        bottom, half = bottom - BOARD_HEIGHT, gates[gate, 9]
        top = bottom + PYLON_HEIGHT
        for side, height in ((-half, bottom), (half, bottom), (half, top), (-half, top)):
            corner_W = (x + side * gates[gate, 6], y + side * gates[gate, 7], height)
            corner_B = rotate_back(R_WB, corner_W)
            observation[k], observation[k + 1], observation[k + 2] = corner_B
            k += 3
    for i in range(len(last_action)):
        observation[k + i] = last_action[i]
