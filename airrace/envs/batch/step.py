"""One step of an environment, for many drones, in machine code.

It is what happens between two actions in the Simulation diagram with a RateController: the same
systems in the same order, each at its own rate.
"""

import math
from typing import NamedTuple

import numpy as np

from airrace.common.jit import compiled_in_threads, inlined
from airrace.envs.batch.contact import Shape, is_near_something, touches_gate, touches_ground
from airrace.envs.batch.courses import Courses
from airrace.envs.batch.fleet import Bodies, Fleet
from airrace.envs.batch.lanes import (
    LANES,
    WANTED,
    WIND,
    control_rates,
    follow_commands,
    load,
    make_block,
    motion_in,
    set_motion,
    step_plant,
    store,
    sum_thrusts,
)
from airrace.envs.reward import RUNNING, CourseNumbers, RewardWeights, judge, of_a_piece
from airrace.math.triples import dot
from airrace.systems.control.rate_law import RateParameters
from airrace.systems.policy.command_scale import CommandScale
from airrace.systems.policy.gates_observation import write_gates_observation
from airrace.track.gate_opening import find
from airrace.vehicle.free_body import Motion
from airrace.vehicle.state import as_plant_state

_FASTER = 5.0  # m/s, by which a drone may get faster within a piece, and more than it does


class Clock(NamedTuple):
    """How often things happen."""

    dt: float  #: of the plant (s)
    steps: int  #: of the plant between two ticks of rotors and rate controller
    ticks: int  #: in a piece, after which the flight is judged
    wind_steps: int  #: of the plant between two values of the wind
    pieces: int  #: between two actions, see EnvOptions.pieces()
    period: float  #: between two actions (s)


class World(NamedTuple):
    """What does not change while the drones fly."""

    clock: Clock  #: how often things happen
    bodies: Bodies  #: all drones
    shape: Shape  #: what of a drone can touch something
    courses: Courses  #: the tracks
    scale: CommandScale  #: what actions stand for
    by_rates: bool  #: whether they are thrust and body rates, and not rotor speeds
    rates: RateParameters  #: of the rate controller
    weights: RewardWeights  #: of the reward
    time_limit: int  #: in actions
    fade: float  #: of the gusts over one of their periods, see Wind
    push: float  #: of their noise (m/s)


class Results(NamedTuple):
    """What a step gives back, for N drones."""

    observations: np.ndarray  #: (N, k) float32
    rewards: np.ndarray  #: (N,)
    outcomes: np.ndarray  #: why an episode is over, see reward.REASONS, (N,)
    truncated: np.ndarray  #: whether the time is over, (N,)


@compiled_in_threads
def advance(
    first: int,
    last: int,
    actions: np.ndarray,
    gusts: np.ndarray,
    idle: np.ndarray,
    world: World,
    fleet: Fleet,
    results: Results,
) -> None:
    """Makes a step with the drones from first on, up to but without last.

    Args:
        actions: (N, m), -1 to 1.
        gusts: standard normal numbers for the wind, (N, values in a step, 3); (0, 0, 0) without.
        idle: whether a drone is left out, (N,).
        world, fleet: of all drones. results: are written.
    """
    n, queue, size = fleet.speeds.shape[1], fleet.commands.shape[1], actions.shape[1]
    block = make_block(n, queue)
    touched = np.empty(LANES, np.bool_)
    for i in range(first, last, LANES):
        count = min(LANES, last - i)
        load(block, i, count, fleet, world.bodies)
        for lane in range(count):
            for k in range(size):
                share = min(max(actions[i + lane, k], -1.0), 1.0)
                fleet.action[i + lane, k] = share
                wanted = world.scale.center[k] + world.scale.half_range[k] * share
                if world.by_rates:
                    block.rows[(WANTED + k) * LANES + lane] = wanted
                else:
                    block.new[k * LANES + lane] = wanted
            if not idle[i + lane]:
                results.rewards[i + lane], results.outcomes[i + lane] = 0.0, RUNNING
        for piece in range(world.clock.pieces):
            _fly(i, count, block, touched, gusts, piece, world, fleet)
            for lane in range(count):
                if not idle[i + lane] and results.outcomes[i + lane] == RUNNING:
                    store(block, lane, i + lane, fleet)
                    _judge(i + lane, touched[lane], piece, world, fleet, results)
        for k in range(i, i + count):
            if not idle[k]:
                fleet.steps[k] += 1
                over = results.outcomes[k] != RUNNING
                results.truncated[k] = fleet.steps[k] >= world.time_limit and not over
    observe_all(np.arange(first, last), world, fleet, results)


@inlined
def _judge(i, touched, piece, world, fleet, results):
    """Adds what a piece of the step of drone i comes to."""
    courses, track, passed = world.courses, fleet.track[i], fleet.passed[i]
    course = CourseNumbers(
        courses.gates[track, : courses.counts[track]],
        courses.goals[track] + fleet.first_gate[i],
        courses.take_off_height[track],
        courses.arena_min[track],
        courses.arena_max[track],
    )
    before, p, w = fleet.before[i], fleet.state[i, 4:7], fleet.state[i, 7:10]
    weights = of_a_piece(world.weights, world.clock.pieces)
    judgement = judge(before, p, w, touched, passed, fleet.airborne[i], course, weights)
    if judgement.passed > passed and passed % len(course.gates) == 0:
        share, _ = find(course.gates[0], before, p)
        time = (fleet.steps[i] + (piece + share) / world.clock.pieces) * world.clock.period
        fleet.lap_time[i] = time - fleet.lap_began[i]
        fleet.lap_began[i] = time
    for k in range(3):
        fleet.before[i, k] = p[k]
    fleet.passed[i], fleet.airborne[i] = judgement.passed, judgement.airborne
    results.rewards[i] += judgement.reward
    results.outcomes[i] = judgement.outcome


@compiled_in_threads
def observe_all(drones: np.ndarray, world: World, fleet: Fleet, results: Results) -> None:
    """Writes the observations of some drones, (k,), as they are."""
    for i in drones:
        track, state = fleet.track[i], as_plant_state(fleet.state[i])
        gates = world.courses.gates[track, : world.courses.counts[track]]
        observation = results.observations[i]
        write_gates_observation(observation, state, gates, fleet.passed[i], fleet.action[i])


@inlined
def _fly(first, count, block, touched, gusts, piece, world, fleet):
    """Flies a block of drones, from number first on, to the end of a piece of the step.

    It sets ``touched`` for each that touches something, but for its pad.
    """
    clock, bodies, shape, courses = world.clock, world.bodies, world.shape, world.courses
    near, standing = np.zeros(LANES, np.bool_), False
    for lane in range(count):
        motion, track = motion_in(block.rows, lane), fleet.track[first + lane]
        v = motion.velocity
        way = (math.sqrt(dot(v, v)) + _FASTER) * clock.period / clock.pieces
        near[lane] = is_near_something(motion.position, way + shape.reach, track, courses)
        touched[lane] = False
        standing = standing or not fleet.airborne[first + lane]
    some_near = near.any()
    sum_thrusts(block, bodies.levers)
    for step in range(clock.ticks * clock.steps):
        at_tick = step % clock.steps == 0
        if at_tick and world.by_rates:
            control_rates(block, world.rates)
        if some_near:
            for lane in range(count):
                if near[lane]:
                    motion, i = motion_in(block.rows, lane), first + lane
                    touched[lane] |= touches_gate(motion, shape, fleet.track[i], courses)
                    touched[lane] |= fleet.airborne[i] and touches_ground(motion, shape)
        before = block.rows
        if standing:
            before = block.rows.copy()
        step_plant(block, bodies.drag, clock.dt)
        if standing:
            for lane in range(count):  # those on their pads stay where they are, and still
                i = first + lane
                pad = courses.pads[fleet.track[i], 6]
                if not fleet.airborne[i] and block.rows[6 * LANES + lane] <= pad:
                    was, still = motion_in(before, lane), (0.0, 0.0, 0.0)
                    set_motion(block.rows, lane, Motion(was.quaternion, was.position, still, still))
        # What follows is seen by the next step of the plant.
        if at_tick:
            follow_commands(block, bodies)
            sum_thrusts(block, bodies.levers)
        if gusts.shape[1] > 0:
            since = piece * clock.ticks * clock.steps + step
            _blow(first, count, since, block, gusts, world, fleet)


@inlined
def _blow(first, count, step, block, gusts, world, fleet):
    """Advances the wind at a block, if a step of the plant ends one of its periods.

    That is the step that begins at a multiple of the period since the start, see
    systems/plant/wind.py.
    """
    clock = world.clock
    for lane in range(count):
        i = first + lane
        total = fleet.steps[i] * clock.pieces * clock.ticks * clock.steps + step
        if total > 0 and total % clock.wind_steps == 0:
            for k in range(3):
                rest = (1.0 - world.fade) * fleet.mean_wind[i, k]
                noise = world.push * gusts[i, step // clock.wind_steps, k]
                now = block.rows[(WIND + k) * LANES + lane]
                block.rows[(WIND + k) * LANES + lane] = rest + world.fade * now + noise
