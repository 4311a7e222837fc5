"""The race for many drones at once, as a vector environment of Gymnasium."""

import math
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from airrace.common.errors import UserError
from airrace.envs.action import action_scale
from airrace.envs.batch.contact import load_shape
from airrace.envs.batch.courses import make_courses
from airrace.envs.batch.dynamics import make_bodies
from airrace.envs.batch.fleet import START_NUMBERS, STARTS, hover_speeds, make_fleet, restart
from airrace.envs.batch.flight import Clock, Results, World, advance, observe_all
from airrace.envs.reward import RUNNING, RewardWeights
from airrace.math.random import make_generator
from airrace.scenario import Scenario
from airrace.systems.control.command_scale import unscaled
from airrace.systems.control.gates_observation import observation_size
from airrace.systems.control.rate_law import make_rate_parameters
from airrace.systems.plant.wind import PERIOD as WIND_PERIOD
from airrace.track import load_track
from airrace.track.generator import generate_track
from airrace.vehicle import GRAVITY, load_vehicle

GENERATED = "generated"
ACTIONS = ("ctbr", "rotors")
_PERIOD = 0.02  # s, between two actions
_PLACES = 64  # of generated tracks, if nobody says how many


class RaceVectorEnv(VectorEnv):
    """N drones, each alone on its track, in machine code: `airrace/Race-v0` as a batch.

    Actions, observations, reward and ends of episodes are those of RaceEnv, with the
    observation ``gates``. The drones fly as in its Simulation diagram: see flight.py. What is
    different: a drone on its pad is held there until it lifts off, and drones touch nothing
    without being out of the race, so that nothing is computed of how they bounce.

    ``info`` of a step has arrays of one element a drone: ``passed``, gates that were passed in
    the episode; ``lap_time``, of its last lap from gate 1 to gate 1 (s), NaN without;
    ``outcome``, an index of reward.REASONS; ``track``, an index of the tracks.
    """

    def __init__(
        self,
        num_envs: int = 1,
        *,
        track: str = "student-airrace",
        tracks: Iterable[int] = range(_PLACES),
        drone: str = "Default",
        action: str = "ctbr",
        gates: int = 2,
        start: str = "pad",
        laps: int = 10,
        time_limit: float = 30.0,
        weights: RewardWeights = RewardWeights(),
        scenario: Scenario | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        num_threads: int = 1,
    ):
        """Constructs the drones; their episodes begin with reset().

        Args:
            num_envs: how many drones.
            track: name of a shipped track, a file, or "generated".
            tracks: seeds of the generated tracks, one of which each episode is on.
            drone: a shipped drone, or the folder of one.
            action: "ctbr", thrust and body rates, or "rotors"; see action.py.
            gates: how many next gates are observed.
            start: "pad"; "hover", over it at rest; or "random", in front of some gate.
            laps: after which a race is finished.
            time_limit: of an episode (s).
            weights: of the reward.
            scenario: whose rates, disturbances and referee are those of the world.
            autoreset_mode: NEXT_STEP or SAME_STEP.
            num_threads: that fly the drones; the results are the same with any number.

        Raises:
            UserError: for an option that there is not.
        """
        scenario = scenario or Scenario()
        self.num_envs = num_envs
        self._mode = AutoresetMode(autoreset_mode)
        _check(action, start, self._mode, scenario)
        self.metadata = {"render_modes": [], "autoreset_mode": self._mode}
        self._scenario, self._start = scenario, STARTS.index(start)
        self._vehicle, sdf = load_vehicle(drone)
        shape = load_shape(self._vehicle, sdf)
        found = [generate_track(s) for s in tracks] if track == GENERATED else [load_track(track)]
        courses = make_courses(
            found,
            laps=laps,
            arena_margin=scenario.referee.arena_margin,
            radius=self._vehicle.radius,
            standing_height=shape.standing_height,
        )
        clock = _make_clock(scenario)
        wind, period = scenario.disturbances.wind, 1.0 / scenario.rotors.rate
        fade = math.exp(-WIND_PERIOD / wind.gust_time)
        scale = action_scale(action, self._vehicle)
        self._world = World(
            clock=clock,
            bodies=make_bodies(self._vehicle, num_envs, period, scenario.disturbances.drag),
            shape=shape,
            courses=courses,
            scale=scale,
            by_rates=action == "ctbr",
            rates=make_rate_parameters(self._vehicle, scenario.rotors.rate),
            weights=weights,
            time_limit=round(time_limit / clock.period),
            fade=fade,
            push=wind.gust_rms * math.sqrt(1.0 - fade * fade),
        )
        size, rotors = len(scale.center), len(self._vehicle.rotors)
        delay = scenario.disturbances.actuator_delay
        queue = 1 + (max(1, round(delay / period)) if delay > 0.0 else 0)
        self._fleet = make_fleet(num_envs, rotors, size, queue)
        length = observation_size(gates, size)
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
        hover = [self._vehicle.mass * GRAVITY, 0.0, 0.0, 0.0] if action == "ctbr" else self._hover
        #: the action that holds the drone in the air if it is level and at rest
        self.hover_action = unscaled(np.array(hover), scale).astype(np.float32)
        self._ended = np.ones(num_envs, bool)
        self._idle = np.zeros(num_envs, bool)
        # One part of the drones for each thread.
        edges = np.linspace(0, num_envs, min(num_threads, num_envs) + 1).round().astype(int)
        self._parts = list(zip(edges.tolist(), edges[1:].tolist()))
        self._pool = ThreadPoolExecutor(len(self._parts)) if len(self._parts) > 1 else None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begins new episodes of all drones.

        Args:
            seed: of all that is drawn at random, from now on.
            options: ``tracks``, the index of the track for each drone, for these episodes.
        """
        super().reset(seed=seed)
        drawn = int(self.np_random.integers(2**31))
        self._starts = make_generator(drawn, "starts")
        self._winds = make_generator(drawn, "wind")
        self._ended[:] = False
        everyone = np.arange(self.num_envs)
        self._begin(everyone, (options or {}).get("tracks"))
        observe_all(everyone, self._world, self._fleet, self._results)
        return self._results.observations.copy(), self._info()

    def step(
        self, actions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Flies all drones for 20 ms; those whose episode is over begin a new one.

        Args:
            actions: -1 to 1, (num_envs, m).

        Raises:
            ValueError: for actions of another shape, or that are not finite.
        """
        actions = self._checked(actions)
        results = self._results
        self._idle[:] = self._ended  # only with NEXT_STEP
        gusts = np.empty((self.num_envs, 0, 3))
        if self._world.push > 0.0:
            gusts = self._winds.standard_normal((self.num_envs, self._values_of_wind(), 3))
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
            info |= {"final_obs": results.observations.copy(), "_final_obs": ended}
            info |= {"final_info": self._info(), "_final_info": ended}
            over = np.flatnonzero(ended)
            self._begin(over)
            observe_all(over, self._world, self._fleet, results)
        elif self._mode is AutoresetMode.NEXT_STEP:
            self._ended[:] = ended
        return results.observations.copy(), results.rewards.copy(), terminated, truncated, info

    def close_extras(self, **kwargs: Any) -> None:
        """Ends the threads."""
        if self._pool is not None:
            self._pool.shutdown()

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
        fleet, bodies, wind = self._fleet, self._world.bodies, self._scenario.disturbances.wind
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
        config, bodies = self._scenario.disturbances, self._world.bodies
        if config.mass_error == config.inertia_error == config.thrust_coefficient_error == 0.0:
            return
        rotors = len(self._vehicle.rotors)
        errors = self._starts.uniform(-1.0, 1.0, (len(drones), 2 + rotors))
        bodies.mass[drones] = self._vehicle.mass * (1.0 + config.mass_error * errors[:, 0])
        share = 1.0 + config.inertia_error * errors[:, 1:2]
        bodies.inertia[drones] = share * np.array(self._vehicle.inertia)
        share = 1.0 + config.thrust_coefficient_error * errors[:, 2:]
        bodies.thrust_coefficients[drones] = share * self._vehicle.thrust_coefficients

    def _checked(self, actions):
        """Returns actions as an array of float64, (N, m)."""
        try:
            result = np.ascontiguousarray(actions, float)
        except (TypeError, ValueError):
            raise ValueError(f"The actions must be an array of numbers, not {actions!r}.") from None
        if result.shape != self.action_space.shape:
            raise ValueError(
                f"The actions must have the shape {self.action_space.shape}, not {result.shape}."
            )
        if not np.isfinite(result).all():
            drone = int(np.flatnonzero(~np.isfinite(result).all(axis=1))[0])
            raise ValueError(
                f"The actions must be finite numbers from -1 to 1; that of drone {drone} is "
                f"{result[drone]}."
            )
        return result

    def _values_of_wind(self):
        """Returns how many values the wind has in a step, at most."""
        clock = self._world.clock
        return -(-clock.steps * clock.ticks // clock.wind_steps)

    def _info(self):
        fleet = self._fleet
        info = {
            "passed": fleet.passed - fleet.first_gate,
            "lap_time": fleet.lap_time.copy(),
            "outcome": self._results.outcomes.copy(),
            "track": fleet.track.copy(),
        }
        everyone = np.ones(self.num_envs, bool)
        return info | {f"_{name}": everyone for name in info}


def _make_clock(scenario: Scenario) -> Clock:
    """Returns how often things happen in a scenario.

    Raises:
        UserError: if its rates are no multiples of each other.
    """
    dt, period = scenario.plant_config.time_step, 1.0 / scenario.rotors.rate
    steps, ticks, wind_steps = period / dt, _PERIOD / period, WIND_PERIOD / dt
    for name, number in (
        ("rotors.rate", steps),
        ("rotors.rate", ticks),
        ("plant_config.time_step", wind_steps),
    ):
        if abs(number - round(number)) > 1e-6 or number < 0.5:
            raise UserError(
                f"{name} does not suit a batch of drones: the period of the rotors must be whole "
                f"steps of the plant, and {_PERIOD:g} s whole periods of the rotors."
            )
    return Clock(dt, round(steps), round(ticks), round(wind_steps))


def _check(action, start, mode, scenario):
    for name, value, choices in (("action", action, ACTIONS), ("start", start, STARTS)):
        if value not in choices:
            raise UserError(f"{name} must be one of {', '.join(choices)}, not '{value}'.")
    if mode is AutoresetMode.DISABLED:
        raise UserError("autoreset_mode must be NEXT_STEP or SAME_STEP.")
    if scenario.disturbances.gate_shift > 0.0:
        raise UserError("In a batch of drones gates cannot move: set disturbances.gate_shift to 0.")
    if scenario.rotor_failures:
        raise UserError("In a batch of drones rotors cannot fail: leave out rotor_failures.")
