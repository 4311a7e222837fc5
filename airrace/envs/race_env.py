"""The race as an environment of Gymnasium, around the Simulation diagram."""

import tempfile
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict
from pydrake.common.yaml import yaml_dump_typed
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import Context, Diagram

from airrace.common.errors import UserError
from airrace.diagrams.reference_flight import start_in_flight
from airrace.diagrams.simulation import MakeMonitor
from airrace.envs import reward
from airrace.envs.action import action_scale, check_action
from airrace.envs.env_diagram import MakeEnvDiagram
from airrace.envs.options import (
    GENERATED,
    EnvOptions,
    StepInfo,
    checked_options,
    depends_on_seed,
    make_options,
    make_scenario,
)
from airrace.envs.reward import (
    NEVER,
    REASONS,
    RUNNING,
    RewardWeights,
    judge,
    make_course,
    of_a_piece,
)
from airrace.envs.spectator import Spectator
from airrace.envs.start import draw_start, hover_start
from airrace.scenario import scenario_yaml
from airrace.systems.contract import finite_number, name_of
from airrace.systems.policy.command_scale import scaled
from airrace.systems.policy.gates_observation import (
    GATE_SIZE,
    MOTION_SIZE,
    map_openings,
    observation_size,
    write_gates_observation,
)
from airrace.track import Track, load_track
from airrace.track.gate_opening import OPENING_SIZE
from airrace.track.generator import generate_track
from airrace.trajopt.reference import Reference, reference_vector
from airrace.vehicle import load_vehicle
from airrace.vehicle.state import as_plant_state, as_state

_SEEDS = 2**31  # of episodes
_GATES_PERIOD = 5  # pieces of steps, between two looks at where gates that move stand


class RaceEnv(gymnasium.Env):
    """One drone on one track; see docs/learning.md for actions, observations, and rewards.

    An episode begins at rest on the pad, or in front of a gate. It terminates with a collision, a
    missed gate, the arena left, or the last lap, and is truncated when its time is over. Equal
    seeds of reset() give equal sequences of episodes, to the last bit.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 50}

    def __init__(self, *, render_mode: str | None = None, **options: Any):
        """Constructs the environment.

        Args:
            render_mode: "human", a page in the browser; "rgb_array", what the camera sees; None.
            options: those of EnvOptions.

        Raises:
            UserError: with one sentence on a bad option, or what the scenario names.
        """
        self._options = make_options(**options)
        if render_mode not in (None, *self.metadata["render_modes"]):
            modes = ", ".join(self.metadata["render_modes"])
            raise UserError(f"render_mode must be one of {modes}, or None, not '{render_mode}'.")
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": round(1.0 / self._options.step)}
        self._scenario = make_scenario(self._options)
        if self._options.track != GENERATED:
            load_track(self._scenario.track, markers=True)  # so that it is refused now, if at all
        self._folder: tempfile.TemporaryDirectory | None = None  # of generated tracks
        self._vehicle = load_vehicle(self._scenario.drone)[0]
        self._pieces = self._options.pieces(1.0 / self._scenario.rotors.rate)
        weights = self._options.reward
        weights = weights if isinstance(weights, RewardWeights) else RewardWeights()
        self._weights = of_a_piece(weights, self._pieces)
        self.action_scale = action_scale(self._options.action, self._vehicle)
        size = len(self.action_scale.center)
        self.action_space = Box(-1.0, 1.0, (size,), np.float32)
        self.observation_space = _observation_space(self._options, size)
        self._built: tuple[str, Diagram, Simulator] | None = None
        self._spectator: Spectator | None = None
        self._outcome, self._passed, self._steps = RUNNING, 0, 0
        self._over = True

    @property
    def true_state(self) -> np.ndarray:
        """The drone's true state, whatever is observed: see vehicle/state.py, (13,)."""
        return self._state()

    # What Gymnasium asks for.

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begins an episode; returns its first observation and info.

        Args:
            seed: of this and all later episodes; None: it goes on with the one before.
            options: none are known.
        """
        super().reset(seed=seed)
        if options := checked_options(options):
            raise UserError(f"reset() knows no options, such as {', '.join(options)}.")
        self._seed, self._track = self._draw_track()
        self._start_world()
        self._last_action = np.zeros(len(self.action_scale.center))
        self._steps, self._outcome, self._over = 0, RUNNING, False
        if self.render_mode == "human":
            self._show()
        scale = {name: part.copy() for name, part in self.action_scale._asdict().items()}
        return self._observe(), {**self._info(), "action_scale": scale}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Flies for a step; returns observation, reward, terminated, truncated and info.

        Raises:
            ValueError: if the action has another shape, or is not finite; the episode goes on.
            gymnasium.error.ResetNeeded: if the episode is over.
        """
        action = check_action(action, self.action_space.shape)
        if self._over:
            raise gymnasium.error.ResetNeeded(
                "The episode is over, or has not begun: call reset() before step()."
            )
        action = np.clip(action, -1.0, 1.0)
        before, passed_before = self._state(), self._passed
        self._command(scaled(action, self.action_scale))
        value = self._fly_and_judge()
        self._last_action = action
        if not isinstance(self._options.reward, RewardWeights):
            gate = self._gates()[passed_before % len(self._track.gates)]
            flown = before, self._state(), action, gate, self._passed > passed_before
            given = self._options.reward(StepInfo(*flown, self._outcome, value))
            who = f"The reward {name_of(self._options.reward)}()"
            value = finite_number(who, given)
        terminated = self._outcome != RUNNING
        truncated = not terminated and self._steps >= self._options.steps
        self._over = terminated or truncated
        info = {**self._info(), "passed": self._passed > passed_before}
        if terminated:
            info["reason"] = REASONS[self._outcome]
            if self._outcome == reward.COLLISION:
                info["collision"] = self._touched()
        if self.render_mode == "human":
            self._show()
        return self._observe(), value, terminated, truncated, info

    def render(self) -> np.ndarray | None:
        """Returns what the drone's camera sees, (h, w, 3), with the mode ``rgb_array``."""
        if self.render_mode != "rgb_array":
            return None
        if self._built is None:
            raise gymnasium.error.ResetNeeded("There is nothing to see: call reset() first.")
        if self._spectator is None:
            self._spectator = Spectator(self._vehicle)
        return self._spectator.picture(self._track, self._state(), self._shifts())

    def close(self) -> None:
        """Ends what shows the drone, and the episode; reset() begins another one."""
        self._spectator, self._built, self._over = None, None, True
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None

    # The world of an episode.

    def _draw_track(self) -> tuple[int, Track]:
        """Returns the seed of an episode, and its track."""
        while True:
            seed = int(self.np_random.integers(_SEEDS))
            if self._options.track != GENERATED:
                return seed, load_track(self._scenario.track, markers=True)
            try:
                track = generate_track(seed)
            except UserError:  # some seeds have none
                continue
            if self._folder is None:
                self._folder = tempfile.TemporaryDirectory(prefix="airrace-")
            path = Path(self._folder.name) / "track.yaml"
            path.write_text(yaml_dump_typed(track, schema=Track), encoding="utf-8")
            self._scenario.track = str(path)
            return seed, track

    def _start_world(self):
        """Builds the diagram, or takes the one that there is, and puts the drone at its start."""
        scenario = self._scenario
        scenario.seed = self._seed if depends_on_seed(scenario) else 0
        if self.render_mode == "human":
            self._spectator = self._spectator or Spectator(self._vehicle)
            self._spectator.begin(self._track)
        # What tells two worlds apart.
        key = scenario_yaml(scenario) + yaml_dump_typed(self._track, schema=Track)
        if self._built is None or self._built[0] != key:
            diagram = MakeEnvDiagram(
                scenario,
                action=self._options.action,
                observation=self._options.observation,
                meshcat=self._spectator and self._spectator.meshcat,
            )
            simulator = Simulator(diagram)
            ApplySimulatorConfig(scenario.simulator_config, simulator)
            if self.render_mode == "human":
                simulator.set_target_realtime_rate(1.0)
            self._built = key, diagram, simulator
        _, self._diagram, self._simulator = self._built
        self._set_bodies = MakeMonitor(self._diagram)
        # A context of its own: nothing of the episode before is left.
        self._simulator.reset_context(self._diagram.CreateDefaultContext())
        self._context: Context = self._simulator.get_mutable_context()
        self._passed, self._airborne = 0, False
        standing = float(self._state()[6])
        if self._options.start != "pad":
            at_random = self._options.start == "random"
            start = draw_start(self._track, self._seed) if at_random else hover_start(self._track)
            self._passed, self._airborne = start.gate, True
            start_in_flight(
                self._diagram,
                scenario,
                self._context,
                X_WB=start.X_WB,
                w_WB=start.w_WB,
                v_WB=start.v_WB,
            )
        self._first, goal = self._passed, NEVER
        if self._options.laps is not None:
            goal = self._first + self._options.laps * len(self._track.gates) + 1
        self._course = make_course(
            self._track,
            goal=goal,
            arena_margin=scenario.referee.arena_margin,
            standing_height=standing,
        )
        self._command(np.zeros(len(self.action_scale.center)))
        self._simulator.Initialize()

    def _command(self, command):
        """Sets the input of the diagram to what an action stands for."""
        if self._options.action == "ctbr":
            self._fix("rate_command", command)
        elif self._options.action == "rotors":
            self._fix("rotor_speed_command", command)
        else:
            offset, velocity, yaw = command[:3], command[3:6], command[6]
            position = offset + self._known_state().position
            wanted = Reference(position, velocity, 0.0, 0.0, 0.0, yaw, 0.0, 0.0)
            self._fix("exploration_reference", reference_vector(wanted))
            self._fix("values_time", [self._context.get_time()])

    def _fix(self, port, value):
        self._diagram.GetInputPort(port).FixValue(self._context, value)

    # What is seen of it.

    def _eval(self, port):
        return self._diagram.GetOutputPort(port).Eval(self._context)

    def _state(self) -> np.ndarray:
        """Returns the true floating-base state, (13,)."""
        return self._eval("truth.state").copy()

    def _impulse(self) -> np.ndarray:
        """Returns the sum of all contacts so far, (6,)."""
        simulation = self._diagram.GetSubsystemByName("simulation")
        integral = simulation.GetSubsystemByName("contact_impulse")
        return integral.GetMyContextFromRoot(self._context).get_discrete_state(0).CopyToVector()

    def _shifts(self) -> np.ndarray | None:
        """Returns where gates that move stand, (2 n,) m; None if they do not."""
        if not self._diagram.HasOutputPort("truth.gate_shifts"):
            return None
        return self._eval("truth.gate_shifts")

    def _gates(self) -> np.ndarray:
        """Returns the openings of the gates where they stand now, (n, 15)."""
        gates, shifts = self._course.gates, self._shifts()
        if shifts is None:
            return gates
        return np.column_stack([gates[:, :2] + shifts.reshape(-1, 2), gates[:, 2:]])

    def _known_state(self):
        """Returns the State that the policy is shown: the truth, or an estimate of it."""
        if self._options.observation == "estimate":
            return as_state(self._eval("filtered_estimate"))
        return as_plant_state(self._state())

    def _observe(self):
        state, action = self._known_state(), self._last_action
        gates = np.zeros((1, OPENING_SIZE))
        if self._options.observation == "pixels":
            motion = np.zeros(MOTION_SIZE + len(action), np.float32)
            write_gates_observation(motion, state, gates, 0, action)
            return {"image": self._eval("camera_image").data[:, :, :3].copy(), "motion": motion}
        result = np.zeros(self.observation_space.shape, np.float32)
        if self._options.observation == "gates":
            write_gates_observation(result, state, self._gates(), self._passed, action)
            return result
        known = self._eval("gate_map")  # the corners of gates that it has not are zero
        numbers = {gate.number: row for gate, row in zip(known.gates, map_openings(known.gates))}
        n = len(self._track.gates)
        wanted = [(self._passed + i) % n for i in range(self._options.gates)]
        gates = np.array([numbers.get(i, np.zeros(10)) for i in wanted])
        write_gates_observation(result, state, gates, 0, action)
        for i, number in enumerate(wanted):
            if number not in numbers:
                result[MOTION_SIZE + GATE_SIZE * i : MOTION_SIZE + GATE_SIZE * (i + 1)] = 0.0
        return result

    def _fly_and_judge(self) -> float:
        """Flies to the next action, or to the end of the episode; returns the reward."""
        value, first = 0.0, self._steps * self._pieces + 1
        for piece in range(first, first + self._pieces):
            before, pushes = as_plant_state(self._state()), self._impulse()
            self._simulator.AdvanceTo(piece * (self._options.step / self._pieces))
            if piece % _GATES_PERIOD == 0:
                self._set_bodies(self._context)
            after = as_plant_state(self._state())
            judged = judge(
                before.position,
                after.position,
                after.angular_velocity,
                bool(np.any(self._impulse() != pushes)),
                self._passed,
                self._airborne,
                self._course._replace(gates=self._gates()),
                self._weights,
            )
            self._passed, self._airborne = judged.passed, judged.airborne
            self._outcome = judged.outcome
            value += judged.reward
            if self._outcome != RUNNING:
                break
        self._steps += 1
        return float(value)

    def _touched(self) -> str:
        """Returns what the drone has touched, in the words of the referee."""
        self._simulator.AdvancePendingEvents()  # the referee's, at the end of the step
        return self._eval("truth.referee_status").dnf_reason or "touched something"

    def _info(self) -> dict[str, Any]:
        """Returns what is told beside an observation."""
        return {
            "time": self._steps * self._options.step,
            "gates_passed": self._passed - self._first,
            "next_gate": self._passed % len(self._track.gates) + 1,
            "track": self._track.name,
            "episode_seed": self._seed,
        }

    def _show(self):
        """Shows the drone to who watches."""
        self._diagram.ForcedPublish(self._context)
        self._spectator.follow(self._state())


def _observation_space(options: EnvOptions, actions: int) -> gymnasium.Space:
    if options.observation == "pixels":
        height, width = map(int, options.image_size)
        return Dict(
            {
                "image": Box(0, 255, (height, width, 3), np.uint8),
                "motion": Box(-np.inf, np.inf, (MOTION_SIZE + actions,), np.float32),
            }
        )
    size = observation_size(options.gates, actions)
    return Box(-np.inf, np.inf, (size,), np.float32)
