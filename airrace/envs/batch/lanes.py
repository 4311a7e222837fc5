"""A few drones side by side, for the loops that run a thousand times a simulated second.

The processor does the same arithmetic for several numbers at once (SIMD), if loops over drones are
innermost, without branches, and over numbers that lie side by side. So drones fly in blocks of
LANES: row k of an array is quantity k of all of them, and element [k * LANES + lane] that of one.
The functions called in the loops are those of one drone.
"""

import math
from typing import NamedTuple

import numpy as np

from airrace.common.jit import inlined
from airrace.envs.batch.fleet import Bodies, Fleet
from airrace.math.triples import added, difference, dot, rotate_back, rotation_rows, scaled, times
from airrace.systems.control.rate_law import (
    RateParameters,
    set_limited_thrusts,
    unlimited_thrust,
    wanted_moment,
)
from airrace.systems.control.rotor_commands import speed_command
from airrace.vehicle.free_body import Motion, next_motion
from airrace.vehicle.rotors import next_speed

LANES = 16

# The first row of quantities in Block.rows, see there.
WRENCH, WIND, BODY, WANTED, MOMENT, EXCESS = 13, 17, 20, 24, 28, 31


class Block(NamedTuple):
    """The drones of a block, with n rotors; see above."""

    #: The motion, as Drake's floating-base state (13); from WRENCH on that of the rotors, [f, Mx,
    #: My, Mz]; from WIND on the velocity of the air in the world (m/s); from BODY on mass (kg) and
    #: principal moments of inertia (kg m^2); from WANTED on thrust (N) and body rates (rad/s); from
    #: MOMENT on what the controller wants of it (N m); EXCESS: how far some rotor is beyond its
    #: limits (N). They are one array, because the compiler would have to prove that several do not
    #: overlap.
    rows: np.ndarray
    coefficients: np.ndarray  #: of the rotors' thrusts (N s^2), n
    speeds: np.ndarray  #: of the rotors (rad/s), n
    thrusts: np.ndarray  #: of the rotors (N), n
    commands: np.ndarray  #: q on their way to the rotors, the next first (rad/s), q n
    new: np.ndarray  #: the command that is being made (rad/s), n


@inlined
def make_block(rotors: int, queue: int) -> Block:
    """Returns a block of drones at the origin; queue: of commands on their way to the rotors."""
    rows = np.zeros((EXCESS + 1) * LANES)
    rows[:LANES] = 1.0  # quaternions
    rows[BODY * LANES : WANTED * LANES] = 1.0
    return Block(
        rows,
        np.ones(rotors * LANES),
        np.zeros(rotors * LANES),
        np.zeros(rotors * LANES),
        np.zeros(queue * rotors * LANES),
        np.zeros(rotors * LANES),
    )


@inlined
def load(block: Block, first: int, count: int, fleet: Fleet, bodies: Bodies) -> None:
    """Puts drones first to first + count - 1 into the lanes of a block; others stay as they are."""
    n, queue = fleet.speeds.shape[1], fleet.commands.shape[1]
    for lane in range(count):
        i = first + lane
        for k in range(13):
            block.rows[k * LANES + lane] = fleet.state[i, k]
        for k in range(3):
            block.rows[(WIND + k) * LANES + lane] = fleet.wind[i, k]
            block.rows[(BODY + 1 + k) * LANES + lane] = bodies.inertia[i, k]
        block.rows[BODY * LANES + lane] = bodies.mass[i]
        for k in range(n):
            block.coefficients[k * LANES + lane] = bodies.thrust_coefficients[i, k]
            block.speeds[k * LANES + lane] = fleet.speeds[i, k]
            block.thrusts[k * LANES + lane] = fleet.thrusts[i, k]
            for j in range(queue):
                block.commands[(j * n + k) * LANES + lane] = fleet.commands[i, j, k]


@inlined
def store(block: Block, lane: int, i: int, fleet: Fleet) -> None:
    """Puts a lane back to drone i of the fleet."""
    n, queue = fleet.speeds.shape[1], fleet.commands.shape[1]
    for k in range(13):
        fleet.state[i, k] = block.rows[k * LANES + lane]
    for k in range(3):
        fleet.wind[i, k] = block.rows[(WIND + k) * LANES + lane]
    for k in range(n):
        fleet.speeds[i, k] = block.speeds[k * LANES + lane]
        fleet.thrusts[i, k] = block.thrusts[k * LANES + lane]
        for j in range(queue):
            fleet.commands[i, j, k] = block.commands[(j * n + k) * LANES + lane]


@inlined
def motion_in(rows: np.ndarray, lane: int) -> Motion:
    """Returns the motion of a lane, of Block.rows."""
    quaternion = (rows[lane], rows[LANES + lane], rows[2 * LANES + lane], rows[3 * LANES + lane])
    return Motion(
        quaternion, _triple(rows, 4, lane), _triple(rows, 7, lane), _triple(rows, 10, lane)
    )


@inlined
def _triple(rows, k, lane):
    """Returns rows k to k + 2 of a lane."""
    return (rows[k * LANES + lane], rows[(k + 1) * LANES + lane], rows[(k + 2) * LANES + lane])


@inlined
def set_motion(rows: np.ndarray, lane: int, new: Motion) -> None:
    """Sets the motion of a lane, in Block.rows."""
    q = new.quaternion
    rows[lane], rows[LANES + lane] = q[0], q[1]
    rows[2 * LANES + lane], rows[3 * LANES + lane] = q[2], q[3]
    _set_triple(rows, 4, lane, new.position)
    _set_triple(rows, 7, lane, new.angular_velocity)
    _set_triple(rows, 10, lane, new.velocity)


@inlined
def _set_triple(rows, k, lane, v):
    """Sets rows k to k + 2 of a lane."""
    rows[k * LANES + lane], rows[(k + 1) * LANES + lane] = v[0], v[1]
    rows[(k + 2) * LANES + lane] = v[2]


@inlined
def step_plant(block: Block, drag: np.ndarray, dt: float) -> None:
    """Advances the motion of all lanes by a step of the plant (s), in the air.

    Args: drag: of Bodies; force and moment are those of systems/plant/drag.py.
    """
    linear = (drag[0, 0], drag[0, 1], drag[0, 2])
    quadratic = (drag[1, 0], drag[1, 1], drag[1, 2])
    angular = (drag[2, 0], drag[2, 1], drag[2, 2])
    rows = block.rows
    for lane in range(LANES):
        motion, lift = motion_in(rows, lane), (0.0, 0.0, rows[WRENCH * LANES + lane])
        R_WB = rotation_rows(motion.quaternion)
        v_B = rotate_back(R_WB, difference(motion.velocity, _triple(rows, WIND, lane)))
        w_B = rotate_back(R_WB, motion.angular_velocity)
        drag_per_speed = added(linear, math.sqrt(dot(v_B, v_B)), quadratic)
        force = added(lift, -1.0, times(drag_per_speed, v_B))
        moment = added(_triple(rows, WRENCH + 1, lane), -1.0, times(angular, w_B))
        specific_force = scaled(1.0 / rows[BODY * LANES + lane], force)
        inertia = _triple(rows, BODY + 1, lane)
        set_motion(rows, lane, next_motion(motion, specific_force, moment, inertia, dt))


@inlined
def sum_thrusts(block: Block, levers: np.ndarray) -> None:
    """Sets the wrench to that of the rotors' thrusts; levers: see Bodies."""
    rows, thrusts = block.rows, block.thrusts
    for k in range(4):
        for lane in range(LANES):
            rows[(WRENCH + k) * LANES + lane] = 0.0
        for i in range(len(levers)):
            lever = levers[i, k]
            for lane in range(LANES):
                rows[(WRENCH + k) * LANES + lane] += lever * thrusts[i * LANES + lane]


@inlined
def follow_commands(block: Block, bodies: Bodies) -> None:
    """Advances the rotors by one of their periods, see systems/plant/rotor_bank.py.

    Before, the new command is put behind those that are on their way.
    """
    speeds, thrusts, commands = block.speeds, block.thrusts, block.commands
    coefficients, share = block.coefficients, bodies.step_share
    size, last = len(block.new), len(commands) - len(block.new)
    for k in range(last):
        commands[k] = commands[k + size]
    for k in range(size):
        commands[last + k] = block.new[k]
    for i in range(len(bodies.max_speeds)):
        limit = bodies.max_speeds[i]
        for lane in range(LANES):
            speed, command = speeds[i * LANES + lane], commands[i * LANES + lane]
            speeds[i * LANES + lane] = next_speed(speed, command, limit, share)
        for lane in range(LANES):
            speed, coefficient = speeds[i * LANES + lane], coefficients[i * LANES + lane]
            thrusts[i * LANES + lane] = coefficient * speed * speed


@inlined
def control_rates(block: Block, rates: RateParameters) -> None:
    """Sets the new command to that of rate_law() for the wanted thrust and body rates."""
    rows, new, speeds, n = block.rows, block.new, block.speeds, len(rates.max_speeds)
    inertia = (rates.inertia[0], rates.inertia[1], rates.inertia[2])
    gains = (rates.gains[0], rates.gains[1], rates.gains[2])
    for lane in range(LANES):
        q, _, w, _ = motion_in(rows, lane)
        w_B = rotate_back(rotation_rows(q), w)
        moment = wanted_moment(_triple(rows, WANTED + 1, lane), w_B, inertia, gains)
        _set_triple(rows, MOMENT, lane, moment)
        rows[EXCESS * LANES + lane] = 0.0
    for i in range(n):
        inverse, limit = rates.inverse, rates.max_thrusts[i]
        row = (inverse[i, 0], inverse[i, 1], inverse[i, 2], inverse[i, 3])
        for lane in range(LANES):
            f, moment = rows[WANTED * LANES + lane], _triple(rows, MOMENT, lane)
            new[i * LANES + lane] = unlimited_thrust(row, f, moment)
        for lane in range(LANES):
            thrust, most = new[i * LANES + lane], rows[EXCESS * LANES + lane]
            rows[EXCESS * LANES + lane] = max(most, max(thrust - limit, -thrust))
    thrusts = np.empty(n)
    for lane in range(LANES):
        if rows[EXCESS * LANES + lane] > 0.0:
            f, moment = rows[WANTED * LANES + lane], _triple(rows, MOMENT, lane)
            set_limited_thrusts(thrusts, f, moment, rates.inverse, rates.max_thrusts)
            for i in range(n):
                new[i * LANES + lane] = thrusts[i]
    overdrive = rates.overdrive
    for i in range(n):
        rotor = (rates.max_thrusts[i], rates.thrust_coefficients[i], rates.max_speeds[i])
        for lane in range(LANES):
            thrust, speed = new[i * LANES + lane], speeds[i * LANES + lane]
            new[i * LANES + lane] = speed_command(thrust, speed, rotor, overdrive)
