"""The race for many drones at once, as a vector environment of Gymnasium."""

import contextlib
import math
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from airrace.common.errors import UserError
from airrace.common.plain_values import plain, whole_number
from airrace.envs.action import action_scale, check_action
from airrace.envs.batch import requests
from airrace.envs.batch.contact import load_shape
from airrace.envs.batch.courses import make_courses
from airrace.envs.batch.fleet import START_NUMBERS, hover_speeds, make_bodies, make_fleet, restart
from airrace.envs.batch.lanes import LANES
from airrace.envs.batch.step import Clock, Results, World, advance, observe_all
from airrace.envs.options import GENERATED, EnvOptions, make_options, make_scenario
from airrace.envs.reward import RUNNING, RewardWeights
from airrace.envs.start import STARTS
from airrace.math.random import make_generator
from airrace.scenario import Scenario
from airrace.scenario.checks import check_choice
from airrace.systems.control.rate_law import make_rate_parameters
from airrace.systems.plant.wind import PERIOD as WIND_PERIOD
from airrace.systems.plant.wind import gust_factors
from airrace.systems.policy.command_scale import unscaled
from airrace.systems.policy.gates_observation import observation_size
from airrace.track import Track, load_track
from airrace.track.generator import generate_track
from airrace.vehicle import GRAVITY, load_vehicle

ACTIONS = ("ctbr", "rotors")
MOST = 1_000_000  # drones: some gigabytes
MANY = range(64)  # seeds of generated tracks, if nobody names others


class RaceVectorEnv(VectorEnv):
    """N drones, each alone on its track, in machine code: `airrace/Race-v0` as a batch.

    Actions, observations, rewards and ends of episodes are those of RaceEnv with the observation
    ``gates``, and the drones fly as in its diagram, see step.py. What differs: a drone is held
    by its pad until it lifts off, and of generated tracks there are some, of which each episode
    draws one.

    ``info`` has arrays of one element a drone: what RaceEnv's has of numbers, and ``lap_time``,
    of the last lap of the episode, from gate 1 to gate 1 (s), NaN if there was none;
    ``outcome``, an index of reward.REASONS; and ``track``, an index of the tracks.
    """

    def __init__(
        self,
        num_envs: int = 1,
        *,
        tracks: Iterable[int] = MANY,
        clearance: float = 0.0,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        num_threads: int = 1,
        max_episode_steps: int | None = None,
        **options: Any,
    ):
        """Constructs the drones; their episodes begin with reset().

        Args:
            num_envs: how many drones.
            tracks: seeds of the tracks, if the option ``track`` is "generated".
            clearance: how near to anything is a collision, in flight (m).
            autoreset_mode: one of Gymnasium's, or its name. With DISABLED, who calls begins new
                episodes, by reset() with the option ``reset_mask``.
            num_threads: that fly the drones; the results are the same with any number.
            max_episode_steps: that an episode is truncated after, if its time is not over before.
            options: those of EnvOptions.

        Raises:
            UserError: for an option that there is not, or not in a batch.
        """
        wanted = make_options(**options)
        scenario = make_scenario(wanted)
        self.num_envs = num_envs = whole_number("num_envs", num_envs, 1, MOST)
        num_threads = whole_number("num_threads", num_threads, 1, 1024)
        time_limit = wanted.steps
        if max_episode_steps is not None:
            most = whole_number("max_episode_steps", max_episode_steps, 1)
            time_limit = min(time_limit, most)
        self._mode = requests.autoreset_mode(autoreset_mode)
        weights = _check(wanted, scenario)
        self.metadata = {"render_modes": [], "autoreset_mode": self._mode}
        self._disturbances, self._start = scenario.disturbances, STARTS.index(wanted.start)
        self._vehicle, sdf = load_vehicle(scenario.drone)
        clearance = plain("clearance", float, clearance)
        if not 0.0 <= clearance < math.inf:
            raise UserError(f"clearance must be a number of metres from 0 on, not {clearance}.")
        shape = load_shape(self._vehicle, sdf, clearance)
        generated = wanted.track == GENERATED
        if not generated and tracks is not MANY:
            raise UserError(f"tracks are seeds, for track='{GENERATED}'; leave them out.")
        courses = make_courses(
            _generate(tracks) if generated else [load_track(scenario.track, markers=True)],
            laps=wanted.laps,
            arena_margin=scenario.referee.arena_margin,
            radius=self._vehicle.radius,
            standing_height=shape.standing_height,
            clearance=clearance,
        )
        clock = _make_clock(scenario, wanted)
        wind, period = scenario.disturbances.wind, 1.0 / scenario.rotors.rate
        fade, push = gust_factors(wind)
        scale = action_scale(wanted.action, self._vehicle)
        self._world = World(
            clock=clock,
            bodies=make_bodies(self._vehicle, num_envs, period, scenario.disturbances.drag),
            shape=shape,
            courses=courses,
            scale=scale,
            by_rates=wanted.action == "ctbr",
            rates=make_rate_parameters(self._vehicle, scenario.rotors.rate),
            weights=weights,
            time_limit=time_limit,
            fade=fade,
            push=push,
        )
        size, rotors = len(scale.center), len(self._vehicle.rotors)
        # What the rate controller computes at a tick reaches the rotors at the next.
        queue = 1 + scenario.disturbances.periods_of_delay(period) + self._world.by_rates
        self._fleet = make_fleet(num_envs, rotors, size, queue)
        length = observation_size(wanted.gates, size)
        self._results = Results(
            observations=np.zeros((num_envs, length), np.float32),
            rewards=np.zeros(num_envs),
            outcomes=np.zeros(num_envs, int),
            truncated=np.zeros(num_envs, bool),
        )
        self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (size,), np.float32)
        self.single_observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (length,), np.float32)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._hover = hover_speeds(self._vehicle)
        hover = (
            [self._vehicle.mass * GRAVITY, 0.0, 0.0, 0.0]
            if wanted.action == "ctbr"
            else self._hover
        )
        #: the action that holds the drone in the air if it is level and at rest
        self.hover_action = unscaled(np.array(hover), scale).astype(np.float32)
        self._ended = np.ones(num_envs, bool)  # with SAME_STEP never after reset()
        self._has_begun = False
        self._idle = np.zeros(num_envs, bool)
        # One part of the drones for each thread, in whole blocks: half a block takes as long.
        blocks = math.ceil(num_envs / LANES)
        edges = LANES * np.linspace(0, blocks, min(num_threads, blocks) + 1).round().astype(int)
        edges[-1] = num_envs
        self._parts = list(zip(edges.tolist(), edges[1:].tolist()))
        self._pool = ThreadPoolExecutor(len(self._parts)) if len(self._parts) > 1 else None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begins new episodes of all drones.

        Args:
            seed: of all that is drawn at random, from now on.
            options: ``tracks``, the index of the track for each drone, for these episodes;
                ``reset_mask``, of bool, which drones begin: all others fly on.

        Raises:
            UserError, TypeError, ValueError: see reset_request(); nothing has changed.
            gymnasium.error.ClosedEnvironmentError: after close().
        """
        self._check_open()
        request = requests.reset_request(options, self.num_envs, len(self._world.courses.counts))
        if not self._has_begun and len(request.drones) < self.num_envs:
            raise gymnasium.error.ResetNeeded("The first reset() has to be of all drones.")
        super().reset(seed=seed)
        if seed is not None or len(request.drones) == self.num_envs:
            drawn = int(self.np_random.integers(2**31))
            self._starts = make_generator(drawn, "starts")
            self._winds = make_generator(drawn, "wind")
        self._ended[request.drones], self._has_begun = False, True
        self._results.outcomes[request.drones] = RUNNING
        self._begin(request.drones, request.tracks)
        observe_all(request.drones, self._world, self._fleet, self._results)
        return self._results.observations.copy(), self._info(request.drones)

    def step(
        self, actions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Flies all drones to the next action; those whose episode is over begin a new one.

        Args:
            actions: -1 to 1, (num_envs, m).

        Raises:
            ValueError: see check_action().
            gymnasium.error.ResetNeeded: before the first reset(); with DISABLED, also if the
                episode of some drone is over.
            gymnasium.error.ClosedEnvironmentError: after close().
        """
        self._check_open()
        if not self._has_begun:
            raise gymnasium.error.ResetNeeded("No episode has begun: call reset() before step().")
        if self._mode is AutoresetMode.DISABLED and self._ended.any():
            raise gymnasium.error.ResetNeeded(
                f"The episodes of drones {np.flatnonzero(self._ended).tolist()} are over: call "
                "reset() with the option reset_mask before step()."
            )
        actions = check_action(actions, self.action_space.shape)
        results = self._results
        self._idle[:] = self._ended  # only with NEXT_STEP
        gusts, clock = np.empty((self.num_envs, 0, 3)), self._world.clock
        if self._world.push > 0.0:
            steps = clock.pieces * clock.ticks * clock.steps
            most = -(-steps // clock.wind_steps)  # values of the wind in a step
            gusts = self._winds.standard_normal((self.num_envs, most, 3))
        self._advance(actions, gusts)
        ended = results.truncated | (results.outcomes != RUNNING)
        if self._idle.any():
            again = np.flatnonzero(self._idle)
            ended[again] = False
            results.rewards[again], results.outcomes[again] = 0.0, RUNNING
            results.truncated[again] = False
            self._begin(again)
            observe_all(again, self._world, self._fleet, results)
        truncated = results.truncated.copy()
        terminated = ended & ~truncated
        info = self._info()
        if self._mode is AutoresetMode.SAME_STEP and ended.any():
            final = {"final_obs": results.observations.copy(), "_final_obs": ended}
            final |= {"final_info": info, "_final_info": ended}
            over = np.flatnonzero(ended)
            self._begin(over)
            observe_all(over, self._world, self._fleet, results)
            info = self._info() | final
        elif self._mode is not AutoresetMode.SAME_STEP:
            self._ended[:] = ended
        return results.observations.copy(), results.rewards.copy(), terminated, truncated, info

    def close_extras(self, **kwargs: Any) -> None:
        """Ends the threads."""
        if self._pool is not None:
            self._pool.shutdown()

    def _check_open(self):
        if self.closed:
            raise gymnasium.error.ClosedEnvironmentError(
                "This environment is closed: make another one."
            )

    def _advance(self, actions, gusts):
        """Flies all drones, each part in a thread of its own."""
        common = actions, gusts, self._idle, self._world, self._fleet, self._results
        if self._pool is None:
            advance(0, self.num_envs, *common)
            return
        jobs = [self._pool.submit(advance, *part, *common) for part in self._parts]
        for job in jobs:
            job.result()

    def _begin(self, drones, tracks=None):
        """Begins episodes of some drones, (k,), on tracks that are drawn unless they are given."""
        fleet, bodies, wind = self._fleet, self._world.bodies, self._disturbances.wind
        count = len(self._world.courses.counts)
        drawn = self._starts.integers(count, size=len(drones))
        fleet.track[drones] = drawn if tracks is None else np.asarray(tracks)[drones]
        numbers = self._starts.random((len(drones), START_NUMBERS))
        self._vary(drones)
        restart(drones, self._start, numbers, self._hover, bodies, fleet, self._world.courses)
        angles = self._winds.uniform(0.0, 2.0 * np.pi, len(drones))
        around = np.column_stack([np.cos(angles), np.sin(angles), 0.0 * angles])
        fleet.mean_wind[drones] = np.array(wind.mean) + wind.mean_speed * around
        gust = wind.gust_rms * self._winds.standard_normal((len(drones), 3))
        fleet.wind[drones] = fleet.mean_wind[drones] + gust

    def _vary(self, drones):
        """Draws mass, inertia and thrusts of some drones anew, see true_vehicle()."""
        config, bodies = self._disturbances, self._world.bodies
        if config.mass_error == config.inertia_error == config.thrust_coefficient_error == 0.0:
            return
        rotors = len(self._vehicle.rotors)
        errors = self._starts.uniform(-1.0, 1.0, (len(drones), 2 + rotors))
        bodies.mass[drones] = self._vehicle.mass * (1.0 + config.mass_error * errors[:, 0])
        share = 1.0 + config.inertia_error * errors[:, 1:2]
        bodies.inertia[drones] = share * np.array(self._vehicle.inertia)
        share = 1.0 + config.thrust_coefficient_error * errors[:, 2:]
        bodies.thrust_coefficients[drones] = share * self._vehicle.thrust_coefficients

    def _info(self, drones=slice(None)):
        """Returns what is told of some drones beside their observations."""
        fleet, clock = self._fleet, self._world.clock
        info = {
            "time": fleet.steps * clock.period,
            "gates_passed": fleet.passed - fleet.first_gate,
            "next_gate": fleet.passed % self._world.courses.counts[fleet.track] + 1,
            "lap_time": fleet.lap_time.copy(),
            "outcome": self._results.outcomes.copy(),
            "track": fleet.track.copy(),
        }
        whose = np.zeros(self.num_envs, bool)
        whose[drones] = True
        return info | {f"_{name}": whose for name in info}


def _generate(seeds: Iterable[int]) -> list[Track]:
    """Returns the generated tracks of some seeds, but for those that have none."""
    tracks = []
    if isinstance(seeds, str) or not isinstance(seeds, Iterable):
        raise UserError(f"tracks must be seeds such as range(64), not {seeds!r}.")
    for seed in (whole_number("a seed of tracks", each, 0) for each in seeds):
        with contextlib.suppress(UserError):
            tracks.append(generate_track(seed))
    if not tracks:
        raise UserError("tracks must name seeds of generated tracks, such as range(64).")
    return tracks


def _make_clock(scenario: Scenario, options: EnvOptions) -> Clock:
    """Returns how often things happen in a scenario, with the options' time between two actions.

    Raises:
        UserError: if its rates are no multiples of each other.
    """
    dt, period = scenario.plant_config.time_step, 1.0 / scenario.rotors.rate
    numbers = period / dt, options.step / period, WIND_PERIOD / dt
    if any(abs(number - round(number)) > 1e-6 or number < 0.5 for number in numbers):
        raise UserError(
            "In a batch of drones, 1 / rotors.rate must be whole steps of the plant, and so must "
            f"be the wind's {WIND_PERIOD:g} s."
        )
    steps, ticks, wind_steps = map(round, numbers)
    pieces = options.pieces(period)
    return Clock(dt, steps, ticks // pieces, wind_steps, pieces, period=dt * steps * ticks)


def _check(options: EnvOptions, scenario: Scenario) -> RewardWeights:
    """Returns the weights of the reward, if all options suit a batch.

    Raises:
        UserError: that says which one does not.
    """
    check_choice("In a batch of drones, action", options.action, ACTIONS)
    check_choice("In a batch of drones, observation", options.observation, ("gates",))
    if not isinstance(options.reward, RewardWeights):
        raise UserError("In a batch of drones, reward must be RewardWeights.")
    for wrong, text in (
        (scenario.disturbances.gate_shift > 0.0, "gates cannot move: take a level below 4"),
        (scenario.rotor_failures, "rotors cannot fail: leave out rotor_failures"),
        (scenario.rotors.rate != scenario.controller.rate, "rotors.rate must be controller.rate"),
    ):
        if wrong:
            raise UserError(f"In a batch of drones, {text}.")
    return options.reward
