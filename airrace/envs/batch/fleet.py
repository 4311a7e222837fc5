"""The drones of a batch, and where their episodes start."""

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from airrace.envs.batch.courses import Courses
from airrace.envs.start import DISTANCE, HEIGHT, RATE, SIDE, SPEED, STARTS, TILT, YAW
from airrace.vehicle import GRAVITY, Vehicle
from airrace.vehicle.rotors import make_rotor_dynamics

_PAD, _HOVER = map(STARTS.index, ("pad", "hover"))
START_NUMBERS = 13  # uniform ones from 0 to 1 that a start is made of, see restart()


class Bodies(NamedTuple):
    """What N drones are made of; a row is one drone, which has n rotors."""

    mass: np.ndarray  #: (kg), (N,)
    inertia: np.ndarray  #: principal moments in B (kg m^2), (N, 3)
    thrust_coefficients: np.ndarray  #: c_f of each rotor (N s^2), (N, n)
    max_speeds: np.ndarray  #: of each rotor (rad/s), (n,)
    #: How much of a step in the command a rotor makes in one period, see vehicle/rotors.py.
    step_share: float
    #: What thrust and moments [f, Mx, My, Mz] a thrust of 1 N of each rotor gives, (n, 4).
    levers: np.ndarray
    #: Linear, quadratic and angular coefficients, see systems/plant/drag.py, (3, 3).
    drag: np.ndarray


class Fleet(NamedTuple):
    """The state of N drones with n rotors, whose actions are of m numbers."""

    state: np.ndarray  #: Drake's floating-base state, see vehicle/state.py, (N, 13)
    before: np.ndarray  #: p_WB at the beginning of the step (m), (N, 3)
    speeds: np.ndarray  #: of the rotors (rad/s), (N, n)
    thrusts: np.ndarray  #: (N), (N, n)
    #: Rotor speeds on their way to the rotors, the next first (rad/s), (N, q, n).
    commands: np.ndarray
    wind: np.ndarray  #: velocity of the air in the world (m/s), (N, 3)
    mean_wind: np.ndarray  #: about which it varies (m/s), (N, 3)
    action: np.ndarray  #: the last one, (N, m)
    track: np.ndarray  #: index of the track, (N,)
    first_gate: np.ndarray  #: that the episode began in front of, (N,)
    passed: np.ndarray  #: gates that were passed, and first_gate more, (N,)
    airborne: np.ndarray  #: whether the drone has taken off, (N,)
    steps: np.ndarray  #: that were made in the episode, (N,)
    #: When gate 1 was passed last in the episode (s), NaN if it was not, (N,).
    lap_began: np.ndarray
    lap_time: np.ndarray  #: of the last lap in the episode (s), NaN if there was none, (N,)


def make_bodies(vehicle: Vehicle, count: int, rotor_period: float, drag_share: float) -> Bodies:
    """Returns equal drones, as the vehicle's file describes them, with a share of its drag.

    Args: rotor_period: between two updates of the rotors' speeds (s).
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
        fleet: is changed.
    """
    track = fleet.track[drones]
    gate, state = np.zeros(len(drones), int), np.zeros((len(drones), 13))
    speeds = np.zeros_like(hover) if start == _PAD else hover
    if start == _PAD:
        state[:, :7] = courses.pads[track]
    elif start == _HOVER:
        half = 0.5 * courses.hover[track, 3]
        state[:, 0], state[:, 3] = np.cos(half), np.sin(half)
        state[:, 4:7] = courses.hover[track, :3]
    else:
        counts = courses.counts[track]
        gate = np.minimum((numbers[:, 0] * counts).astype(int), counts - 1)
        state = _in_front(numbers.T, courses.gates[track, gate].T).T
    fleet.state[drones], fleet.before[drones] = state, state[:, 4:7]
    fleet.speeds[drones] = speeds
    fleet.thrusts[drones] = bodies.thrust_coefficients[drones] * speeds * speeds
    fleet.commands[drones] = 0.0  # nobody has sent one yet
    fleet.action[drones] = 0.0
    fleet.first_gate[drones] = fleet.passed[drones] = gate
    fleet.airborne[drones] = start != _PAD
    fleet.steps[drones] = 0
    fleet.lap_began[drones] = fleet.lap_time[drones] = math.nan


def _in_front(numbers: np.ndarray, gate: np.ndarray) -> np.ndarray:
    """Returns states of hovers in front of gates that were disturbed, (13, k), see envs/start.py.

    Args:
        numbers: see restart(), (START_NUMBERS, k).
        gate: numbers of the gates' openings, (15, k).
    """
    u = 2.0 * numbers - 1.0  # from -1 to 1
    distance, side = DISTANCE[0] + (DISTANCE[1] - DISTANCE[0]) * numbers[1], SIDE * u[2]
    yaw = np.arctan2(gate[4], gate[3]) + YAW * u[4]
    angles = np.column_stack([TILT * u[5], TILT * u[6], yaw])
    x = gate[0] - distance * gate[3] + side * gate[6]
    y = gate[1] - distance * gate[4] + side * gate[7]
    quaternions = Rotation.from_euler("xyz", angles).as_quat(scalar_first=True).T
    return np.vstack([quaternions, x, y, gate[2] + HEIGHT * u[3], RATE * u[7:10], SPEED * u[10:13]])
