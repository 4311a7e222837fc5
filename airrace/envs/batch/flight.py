"""One step of an environment, for many drones, in machine code.

It is what happens between two actions in the Simulation diagram with a RateController: the same
systems in the same order, each at its own rate.
"""

import math
from typing import NamedTuple

import numpy as np

from airrace.common.jit import compilable, compiled_in_threads
from airrace.envs.batch.contact import Shape, is_near_something, touches_gate, touches_ground
from airrace.envs.batch.courses import Courses, course_of
from airrace.envs.batch.dynamics import Bodies, Motion, follow_commands, next_motion, rotor_wrench
from airrace.envs.batch.fleet import Fleet, keep_motion, motion_of
from airrace.envs.reward import RUNNING, RewardWeights, judge
from airrace.math.triples import dot, rotate_back, rotation_rows
from airrace.systems.control.command_scale import CommandScale, scaled
from airrace.systems.control.gates_observation import write_gates_observation
from airrace.systems.control.rate_law import RateParameters, rate_law
from airrace.track.gate_opening import find
from airrace.vehicle.state import as_plant_state

_FASTER = 5.0  # m/s, by which a drone may get faster within a step, and more than it does


class Clock(NamedTuple):
    """How often things happen.

    Attributes:
        dt: of the plant (s).
        steps: of the plant between two ticks of rotors and rate controller.
        ticks: between two actions.
        wind_steps: of the plant between two values of the wind.
    """

    dt: float
    steps: int
    ticks: int
    wind_steps: int

    @property
    def period(self) -> float:
        """Between two actions (s)."""
        return self.dt * self.steps * self.ticks


class World(NamedTuple):
    """What does not change while the drones fly.

    Attributes:
        clock: how often things happen.
        bodies: all drones.
        shape: what of a drone can touch something.
        courses: the tracks.
        scale: what actions stand for.
        by_rates: whether they are thrust and body rates, and not rotor speeds.
        rates: of the rate controller.
        weights: of the reward.
        time_limit: in actions.
        fade: of the gusts over one of their periods, see Wind. push: of their noise (m/s).
    """

    clock: Clock
    bodies: Bodies
    shape: Shape
    courses: Courses
    scale: CommandScale
    by_rates: bool
    rates: RateParameters
    weights: RewardWeights
    time_limit: int
    fade: float
    push: float


class Results(NamedTuple):
    """What a step gives back, for N drones.

    Attributes:
        observations: (N, k) float32.
        rewards: (N,).
        outcomes: why an episode is over, see reward.REASONS, (N,).
        truncated: whether the time is over, (N,).
    """

    observations: np.ndarray
    rewards: np.ndarray
    outcomes: np.ndarray
    truncated: np.ndarray


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
    for i in range(first, last):
        if idle[i]:
            continue
        track, passed = fleet.track[i], fleet.passed[i]
        course = course_of(world.courses, track, fleet.first_gate[i])
        for k in range(actions.shape[1]):
            fleet.action[i, k] = min(max(actions[i, k], -1.0), 1.0)
        touched = _fly(i, gusts, world, fleet)
        fleet.steps[i] += 1
        p, w = fleet.state[i, 4:7], fleet.state[i, 7:10]
        judgement = judge(
            fleet.before[i], p, w, touched, passed, fleet.airborne[i], course, world.weights
        )
        if judgement.passed > passed:
            _note_passage(i, course.gates, passed, world.clock, fleet)
        for k in range(3):
            fleet.before[i, k] = p[k]
        fleet.passed[i], fleet.airborne[i] = judgement.passed, judgement.airborne
        results.rewards[i], results.outcomes[i] = judgement.reward, judgement.outcome
        over = judgement.outcome != RUNNING
        results.truncated[i] = fleet.steps[i] >= world.time_limit and not over
        _observe(i, course.gates, fleet, results.observations)


@compiled_in_threads
def observe_all(drones: np.ndarray, world: World, fleet: Fleet, results: Results) -> None:
    """Writes the observations of some drones, (k,), as they are."""
    for i in drones:
        course = course_of(world.courses, fleet.track[i], fleet.first_gate[i])
        _observe(i, course.gates, fleet, results.observations)


@compilable
def _observe(i, gates, fleet, observations):
    """Writes the observation of drone i, on a track with these gates."""
    write_gates_observation(
        observations[i], as_plant_state(fleet.state[i]), gates, fleet.passed[i], fleet.action[i]
    )


@compilable
def _note_passage(i, gates, passed, clock, fleet):
    """Notes when a gate was passed in the step that is over, if it is gate 1."""
    if passed % len(gates) == 0:
        share, _ = find(gates[0], fleet.before[i], fleet.state[i, 4:7], 0.0, 0.0)
        period = clock.dt * clock.steps * clock.ticks
        time = (fleet.steps[i] - 1 + share) * period
        fleet.lap_time[i] = time - fleet.lap_began[i]
        fleet.lap_began[i] = time


@compilable
def _fly(i, gusts, world, fleet):
    """Flies drone i to its next action; returns whether it touched something, but for its pad."""
    clock, bodies, courses, track = world.clock, world.bodies, world.courses, fleet.track[i]
    motion, touched = motion_of(fleet.state, i), False
    near = _is_near(motion, clock, world.shape, track, courses)
    command = scaled(fleet.action[i], world.scale)
    wanted, w_B = command, np.empty(3)
    if world.by_rates:
        command = np.empty(fleet.speeds.shape[1])
    step, gust = fleet.steps[i] * clock.ticks * clock.steps, 0
    for tick in range(clock.ticks):
        if world.by_rates:
            w = rotate_back(rotation_rows(motion.quaternion), motion.angular_velocity)
            w_B[0], w_B[1], w_B[2] = w
            rate_law(command, wanted, w_B, fleet.speeds[i], world.rates)
        for k in range(clock.steps):
            if near:
                touched |= touches_gate(motion, world.shape, track, courses)
                if fleet.airborne[i]:
                    touched |= touches_ground(motion, world.shape)
            wind = (fleet.wind[i, 0], fleet.wind[i, 1], fleet.wind[i, 2])
            wrench = rotor_wrench(i, fleet.thrusts, bodies)
            after = next_motion(i, motion, wrench, wind, bodies, clock.dt)
            if not fleet.airborne[i] and after.position[2] <= courses.pads[track, 6]:
                still = (0.0, 0.0, 0.0)  # the pad holds it
                after = Motion(motion.quaternion, motion.position, still, still)
            motion = after
            # What follows is seen by the next step of the plant.
            if k == 0 and world.by_rates:
                follow_commands(i, fleet.speeds, fleet.thrusts, fleet.commands, bodies)
                _queue(i, command, fleet.commands)
            elif k == 0:
                _queue(i, command, fleet.commands)
                follow_commands(i, fleet.speeds, fleet.thrusts, fleet.commands, bodies)
            if gust < gusts.shape[1] and step > 0 and step % clock.wind_steps == 0:
                _blow(i, gusts[i, gust], world, fleet)
                gust += 1
            step += 1
    keep_motion(fleet.state, i, motion)
    return touched


@compilable
def _is_near(motion, clock, shape, track, courses):
    """Whether a drone may touch something until its next action."""
    v = motion.velocity
    way = (math.sqrt(dot(v, v)) + _FASTER) * clock.dt * clock.steps * clock.ticks
    return is_near_something(motion.position, way + shape.reach, track, courses)


@compilable
def _queue(i, command, commands):
    """Puts a command for the rotors of drone i, (n,), behind those that are on their way."""
    last = commands.shape[1] - 1
    for k in range(len(command)):
        for j in range(last):
            commands[i, j, k] = commands[i, j + 1, k]
        commands[i, last, k] = command[k]


@compilable
def _blow(i, noise, world, fleet):
    """Advances the wind at drone i by one of its periods, see systems/plant/wind.py."""
    for k in range(3):
        rest = (1.0 - world.fade) * fleet.mean_wind[i, k]
        fleet.wind[i, k] = rest + world.fade * fleet.wind[i, k] + world.push * noise[k]
