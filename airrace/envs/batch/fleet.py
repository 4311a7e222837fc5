"""The drones of a batch, and where their episodes start."""

import math
from typing import NamedTuple

import numpy as np

from airrace.common.jit import compilable, compiled
from airrace.envs.batch.courses import Courses
from airrace.envs.batch.dynamics import Bodies, Motion
from airrace.vehicle import GRAVITY, Vehicle

STARTS = PAD, HOVER, RANDOM = ("pad", "hover", "random")
START_NUMBERS = 13  # uniform ones from 0 to 1 that a start is made of, see restart()


class Fleet(NamedTuple):
    """The state of N drones with n rotors, whose actions are of m numbers.

    Attributes:
        state: Drake's floating-base state, see vehicle/state.py, (N, 13).
        before: p_WB at the beginning of the step (m), (N, 3).
        speeds: of the rotors (rad/s), (N, n).
        thrusts: (N), (N, n).
        commands: rotor speeds on their way to the rotors, the next first (rad/s), (N, q, n).
        wind: velocity of the air in the world (m/s), (N, 3).
        mean_wind: about which it varies (m/s), (N, 3).
        action: the last one, (N, m).
        track: index of the track, (N,).
        first_gate: that the episode began in front of, (N,).
        passed: gates that were passed, and first_gate more, (N,).
        airborne: whether the drone has taken off, (N,).
        steps: that were made in the episode, (N,).
        lap_began: when gate 1 was passed last in the episode (s), NaN if it was not, (N,).
        lap_time: of the last lap in the episode (s), NaN if there was none, (N,).
    """

    state: np.ndarray
    before: np.ndarray
    speeds: np.ndarray
    thrusts: np.ndarray
    commands: np.ndarray
    wind: np.ndarray
    mean_wind: np.ndarray
    action: np.ndarray
    track: np.ndarray
    first_gate: np.ndarray
    passed: np.ndarray
    airborne: np.ndarray
    steps: np.ndarray
    lap_began: np.ndarray
    lap_time: np.ndarray


def make_fleet(count: int, rotors: int, actions: int, queue: int) -> Fleet:
    """Returns drones before their first start.

    Args:
        count: of drones. rotors: of each. actions: numbers of an action.
        queue: number of commands that are on their way, q of Fleet.
    """
    return Fleet(
        state=np.zeros((count, 13)),
        before=np.zeros((count, 3)),
        speeds=np.zeros((count, rotors)),
        thrusts=np.zeros((count, rotors)),
        commands=np.zeros((count, queue, rotors)),
        wind=np.zeros((count, 3)),
        mean_wind=np.zeros((count, 3)),
        action=np.zeros((count, actions)),
        track=np.zeros(count, int),
        first_gate=np.zeros(count, int),
        passed=np.zeros(count, int),
        airborne=np.zeros(count, bool),
        steps=np.zeros(count, int),
        lap_began=np.zeros(count),
        lap_time=np.zeros(count),
    )


def hover_speeds(vehicle: Vehicle) -> np.ndarray:
    """Returns the rotor speeds that hold a drone in the air (rad/s), (n,)."""
    thrusts = np.linalg.pinv(vehicle.allocation) @ [vehicle.mass * GRAVITY, 0.0, 0.0, 0.0]
    return np.sqrt(np.maximum(thrusts, 0.0) / vehicle.thrust_coefficients)


@compilable
def motion_of(state: np.ndarray, i: int) -> Motion:
    """Returns row i of states, (N, 13)."""
    s = state
    return Motion(
        (s[i, 0], s[i, 1], s[i, 2], s[i, 3]),
        (s[i, 4], s[i, 5], s[i, 6]),
        (s[i, 7], s[i, 8], s[i, 9]),
        (s[i, 10], s[i, 11], s[i, 12]),
    )


@compilable
def keep_motion(state: np.ndarray, i: int, motion: Motion) -> None:
    """Writes a motion into row i of states, (N, 13)."""
    q, p, w, v = motion
    state[i, 0], state[i, 1], state[i, 2], state[i, 3] = q[0], q[1], q[2], q[3]
    for k in range(3):
        state[i, 4 + k], state[i, 7 + k], state[i, 10 + k] = p[k], w[k], v[k]


@compiled
def restart(
    drones: np.ndarray,
    start: int,
    numbers: np.ndarray,
    hover: np.ndarray,
    bodies: Bodies,
    fleet: Fleet,
    courses: Courses,
) -> None:
    """Begins new episodes of some drones, on the tracks that fleet.track says.

    Args:
        drones: their numbers, (k,).
        start: index of STARTS.
        numbers: drawn uniformly from 0 to 1, (k, START_NUMBERS).
        hover: rotor speeds that hold a drone in the air (rad/s), (n,).
        bodies: all drones.
        fleet: is changed.
        courses: the tracks.
    """
    for row in range(len(drones)):
        i = drones[row]
        track = fleet.track[i]
        count = courses.counts[track]
        gate = 0
        if start == 0:
            for k in range(7):
                fleet.state[i, k] = courses.pads[track, k]
            fleet.state[i, 7:] = 0.0
        elif start == 1:
            x, y, z, heading = courses.hover[track]
            level = (math.cos(0.5 * heading), 0.0, 0.0, math.sin(0.5 * heading))
            still = (0.0, 0.0, 0.0)
            keep_motion(fleet.state, i, Motion(level, (x, y, z), still, still))
        else:
            gate = min(int(numbers[row, 0] * count), count - 1)
            keep_motion(fleet.state, i, _in_front(numbers[row], gate, courses.gates[track, :count]))
        for k in range(len(hover)):
            speed = hover[k] if start > 0 else 0.0
            fleet.speeds[i, k] = speed
            fleet.thrusts[i, k] = bodies.thrust_coefficients[i, k] * speed * speed
            fleet.commands[i, :, k] = speed
        fleet.before[i] = fleet.state[i, 4:7]
        fleet.action[i] = 0.0
        fleet.first_gate[i] = fleet.passed[i] = gate
        fleet.airborne[i] = start > 0
        fleet.steps[i] = 0
        fleet.lap_began[i] = fleet.lap_time[i] = math.nan


@compilable
def _in_front(numbers, gate, gates):
    """Returns a hover that was disturbed, on the way from one gate to the next.

    Args:
        numbers: see restart(). gate: the next one. gates: of the track, (n, 10).
    """
    u = 2.0 * numbers - 1.0  # from -1 to 1
    last = (gate - 1) % len(gates)
    share = 0.05 + 0.85 * numbers[1]  # of the way back from this gate to the last one
    x, y, z = gates[gate, 0], gates[gate, 1], gates[gate, 2]
    back_x, back_y = gates[last, 0] - x, gates[last, 1] - y
    heading = math.atan2(-back_y, -back_x) + 0.8 * u[2]
    roll, pitch = 0.2 * u[3], 0.2 * u[4]
    c, s = math.cos(0.5 * heading), math.sin(0.5 * heading)
    # Yaw, then a small turn about a level axis of the body.
    a, b = 0.5 * roll, 0.5 * pitch
    length = math.sqrt(1.0 + a * a + b * b)
    q = (c / length, (c * a - s * b) / length, (s * a + c * b) / length, s / length)
    p = (x + share * back_x + 1.5 * u[5], y + share * back_y + 1.5 * u[6], z + 3.0 * u[7])
    return Motion(
        q,
        p,
        (0.5 * u[8], 0.5 * u[9], 0.5 * u[10]),
        (1.0 * u[11], 1.0 * u[12], 0.0),
    )
