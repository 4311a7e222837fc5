"""The drones of a batch, and where their episodes start."""

import math
from typing import NamedTuple

import numpy as np

from airrace.common.jit import compiled, inlined
from airrace.envs.batch.courses import Courses
from airrace.envs.start import DISTANCE, HEIGHT, RATE, SIDE, SPEED, STARTS, TILT, YAW
from airrace.vehicle import GRAVITY, Vehicle
from airrace.vehicle.free_body import Motion
from airrace.vehicle.rotors import make_rotor_dynamics

_PAD, _HOVER = map(STARTS.index, ("pad", "hover"))
START_NUMBERS = 13  # uniform ones from 0 to 1 that a start is made of, see restart()


class Bodies(NamedTuple):
    """What N drones are made of; a row is one drone, which has n rotors.

    Attributes:
        mass: (kg), (N,).
        inertia: principal moments in B (kg m^2), (N, 3).
        thrust_coefficients: c_f of each rotor (N s^2), (N, n).
        max_speeds: of each rotor (rad/s), (n,).
        step_share: how much of a step in the command a rotor makes in one period, see
            vehicle/rotors.py.
        levers: what thrust and moments [f, Mx, My, Mz] a thrust of 1 N of each rotor gives, (n, 4).
        drag: linear, quadratic and angular coefficients, see systems/plant/drag.py, (3, 3).
    """

    mass: np.ndarray
    inertia: np.ndarray
    thrust_coefficients: np.ndarray
    max_speeds: np.ndarray
    step_share: float
    levers: np.ndarray
    drag: np.ndarray


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


def make_bodies(vehicle: Vehicle, count: int, rotor_period: float, drag_share: float) -> Bodies:
    """Returns equal drones, as the vehicle's file describes them.

    Args:
        vehicle: the drone.
        count: of drones.
        rotor_period: between two updates of the rotors' speeds (s).
        drag_share: of the vehicle's drag; 0 is none, 1 is all.
    """
    drag = [vehicle.drag.linear, vehicle.drag.quadratic, vehicle.drag.angular]
    rotors = make_rotor_dynamics(vehicle, rotor_period)
    return Bodies(
        mass=np.full(count, vehicle.mass),
        inertia=np.tile(np.array(vehicle.inertia), (count, 1)),
        thrust_coefficients=np.tile(rotors.thrust_coefficients, (count, 1)),
        max_speeds=rotors.max_speeds,
        step_share=rotors.step_share,
        levers=np.ascontiguousarray(vehicle.allocation.T),
        drag=drag_share * np.array(drag),
    )


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


@inlined
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
        start: index of envs.start.STARTS.
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
        if start == _PAD:
            for k in range(7):
                fleet.state[i, k] = courses.pads[track, k]
            fleet.state[i, 7:] = 0.0
        elif start == _HOVER:
            x, y, z, heading = courses.hover[track]
            level = (math.cos(0.5 * heading), 0.0, 0.0, math.sin(0.5 * heading))
            still = (0.0, 0.0, 0.0)
            keep_motion(fleet.state, i, Motion(level, (x, y, z), still, still))
        else:
            gate = min(int(numbers[row, 0] * count), count - 1)
            keep_motion(fleet.state, i, _in_front(numbers[row], courses.gates[track, gate]))
        for k in range(len(hover)):
            speed = hover[k] if start != _PAD else 0.0
            fleet.speeds[i, k] = speed
            fleet.thrusts[i, k] = bodies.thrust_coefficients[i, k] * speed * speed
            fleet.commands[i, :, k] = 0.0  # nobody has sent one yet
        fleet.before[i] = fleet.state[i, 4:7]
        fleet.action[i] = 0.0
        fleet.first_gate[i] = fleet.passed[i] = gate
        fleet.airborne[i] = start != _PAD
        fleet.steps[i] = 0
        fleet.lap_began[i] = fleet.lap_time[i] = math.nan


@inlined
def _in_front(numbers, gate):
    """Returns a hover in front of a gate that was disturbed, see envs/start.py.

    Args:
        numbers: see restart(). gate: numbers of its opening, (15,).
    """
    u = 2.0 * numbers - 1.0  # from -1 to 1
    distance, side = DISTANCE[0] + (DISTANCE[1] - DISTANCE[0]) * numbers[1], SIDE * u[2]
    heading = math.atan2(gate[4], gate[3]) + YAW * u[4]
    quaternion = _from_angles(TILT * u[5], TILT * u[6], heading)
    return Motion(
        quaternion,
        (
            gate[0] - distance * gate[3] + side * gate[6],
            gate[1] - distance * gate[4] + side * gate[7],
            gate[2] + HEIGHT * u[3],
        ),
        (RATE * u[7], RATE * u[8], RATE * u[9]),
        (SPEED * u[10], SPEED * u[11], SPEED * u[12]),
    )


@inlined
def _from_angles(roll, pitch, yaw):
    """Returns the quaternion of R_z(yaw) R_y(pitch) R_x(roll), as RollPitchYaw of Drake."""
    c_x, s_x = math.cos(0.5 * roll), math.sin(0.5 * roll)
    c_y, s_y = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    c_z, s_z = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    return (
        c_z * c_y * c_x + s_z * s_y * s_x,
        c_z * c_y * s_x - s_z * s_y * c_x,
        c_z * s_y * c_x + s_z * c_y * s_x,
        s_z * c_y * c_x - c_z * s_y * s_x,
    )
