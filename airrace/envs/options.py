"""The options of an environment, and the scenario that they make."""

import dataclasses as dc
import difflib
import math
import reprlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from pydrake.common.yaml import yaml_dump

from airrace.common import jit
from airrace.common.errors import UserError
from airrace.common.plain_values import plain, plain_tree, whole_number
from airrace.envs import action
from airrace.envs.reward import RewardWeights
from airrace.envs.start import STARTS
from airrace.scenario import INTERNAL, Scenario, load_scenario
from airrace.scenario.camera_config import NO_CAMERA
from airrace.scenario.checks import check_choice
from airrace.track.map_files import TRACK

OBSERVATIONS = ("gates", "estimate", "pixels")
MAX_PIECE = 0.02  # s, along which a flight counts as a straight line
GENERATED = "generated"  # the track: a new one each episode

jit.announce()  # an environment compiles what its first episodes call


class StepInfo(NamedTuple):
    """What a reward of one's own is made of."""

    #: before, after: the drone's state at both ends of the step, see vehicle/state.py, (13,)
    before: np.ndarray
    after: np.ndarray
    action: np.ndarray  #: that was taken, -1 to 1, (m,)
    gate: np.ndarray  #: numbers of the opening that was next, see Opening, (15,)
    passed: bool  #: whether it was passed
    outcome: int  #: index of reward.REASONS
    reward: float  #: that of reward.judge()


@dc.dataclass(frozen=True, kw_only=True)
class EnvOptions:
    """What ``gymnasium.make("airrace/Race-v0", ...)`` may be told."""

    action: str = "ctbr"  #: one of action.KINDS
    #: "gates": the drone's motion, and the openings of the next gates in its axes, of the truth,
    #: see write_gates_observation(); "estimate": the same from what the drone itself estimates, and
    #: with the map in the place of the track; "pixels": the camera's picture beside the drone's
    #: motion. Numbers are in SI units and not scaled.
    observation: str = "gates"
    gates: int = 2  #: how many next gates are observed
    track: str = "student-airrace"  #: name of a shipped track, a file, or GENERATED
    drone: str = "Default"  #: a shipped drone, or the folder of one
    level: int = 0  #: difficulty, 0 to 4, as --level of a race
    scenario: dict | str = ""  #: fields of a race on top of that: a dict, or YAML
    #: "pad", at rest; "hover", over it; or "random", in front of some gate; see start.py.
    start: str = "pad"
    #: After which the episode is over; None: it goes on until the time is over.
    laps: int | None = None
    time_limit: float = 30.0  #: of an episode (s)
    step: float = 0.02  #: time between two actions (s)
    image_size: tuple[int, int] = (90, 160)  #: of ``pixels``, (height, width) px
    #: RewardWeights, or a function of a StepInfo that returns a number.
    reward: RewardWeights | Callable[[StepInfo], float] = RewardWeights()

    @property
    def steps(self) -> int:
        """After how many steps an episode is truncated."""
        return max(1, round(self.time_limit / self.step))

    def pieces(self, period: float) -> int:
        """Returns in how many equal pieces the flight of a step is judged.

        A flight is judged along straight lines, and on MAX_PIECE it is straight to a millimetre or
        so. Args: period: of the rotors, of which a piece is some whole ones (s).
        """
        ticks = round(self.step / period)
        most = max(1, int(MAX_PIECE / period + 1e-6))
        length = next(n for n in range(min(most, ticks), 0, -1) if ticks % n == 0)
        return ticks // length


def make_options(**options: Any) -> EnvOptions:
    """Returns the options of an environment, checked but for the scenario.

    Raises:
        UserError: with one sentence that names the option and the choices.
    """
    known = [field.name for field in dc.fields(EnvOptions)]
    check_names(options, known, "There is no option")
    given = EnvOptions(**options)
    result = dc.replace(
        given,
        level=whole_number("level", given.level, 0, 4),
        gates=whole_number("gates", given.gates, 1, 20),
        laps=None if given.laps is None else whole_number("laps", given.laps, 1, 1000),
        track=plain("track", str, given.track),
        drone=plain("drone", str, given.drone),
        time_limit=_seconds("time_limit", given.time_limit),
        step=_seconds("step", given.step),
        image_size=_size(given.image_size),
    )
    check_choice("action", result.action, action.KINDS)
    check_choice("observation", result.observation, OBSERVATIONS)
    check_choice("start", result.start, STARTS)
    if not (isinstance(result.reward, RewardWeights) or callable(result.reward)):
        raise UserError("reward must be RewardWeights, or a function of a StepInfo.")
    return result


def _seconds(name, value):
    result = plain(name, float, value)
    if not 0.0 < result < math.inf:
        raise UserError(f"{name} must be a positive number of seconds, not {value}.")
    return result


def _size(value):
    try:
        height, width = value
    except (TypeError, ValueError):
        raise UserError(f"image_size must be (height, width), not {value!r}.") from None
    return tuple(whole_number("image_size", each, 16, 8192) for each in (height, width))


def make_scenario(options: EnvOptions) -> Scenario:
    """Returns the scenario of the options: the world, and what estimates, of all episodes.

    Its track and its seed are those of the first one. Where nobody looks at pictures or at the
    state estimate, there is no camera and no noise.

    Raises:
        UserError: naming the field and the remedy.
    """
    text = options.scenario
    if not isinstance(text, str):
        text = yaml_dump(plain_tree("scenario", text))
    scenario = load_scenario(
        filename="levels", scenario_name=f"Level{options.level}", scenario_text=text
    )
    scenario.drone = options.drone
    if options.track != GENERATED:
        scenario.track = options.track
    if options.observation == "pixels":
        scenario.camera.height, scenario.camera.width = map(int, options.image_size)
    elif options.observation == "gates":
        scenario.camera.renderer, scenario.map = NO_CAMERA, TRACK
    elif scenario.map:
        scenario.camera.renderer = NO_CAMERA
    if options.observation != "estimate":
        if scenario.localizes:
            raise UserError(
                f"The estimator 'vio' is for the observation 'estimate', not for "
                f"'{options.observation}'."
            )
        if options.action != "reference":
            scenario.state_noise = "none"
    if scenario.flight_controller != INTERNAL:
        raise UserError("Environments fly with flight_controller internal, as it is by default.")
    scenario.laps = 10  # ample: the referee only says what was touched
    scenario.referee.time_limit = 10.0 * options.time_limit
    # Actions come at ticks of the rotors.
    for name, rate in (("rotors", scenario.rotors.rate), ("controller", scenario.controller.rate)):
        ticks = options.step * rate
        if abs(ticks - round(ticks)) > 1e-6 or ticks < 0.5:
            raise UserError(
                f"step must be a multiple of the period of {name}.rate, {1 / rate:g} s, "
                f"not {options.step:g} s."
            )
    scenario.check()
    return scenario


def depends_on_seed(scenario: Scenario) -> bool:
    """Whether anything in the simulated world of a scenario is drawn from its seed."""
    air = scenario.disturbances
    errors = (air.mass_error, air.inertia_error, air.thrust_coefficient_error, air.gate_shift)
    wind = (air.wind.mean_speed, air.wind.gust_rms)
    effects = scenario.camera.resolved()
    pictures = scenario.camera.renderer != NO_CAMERA and (effects.read_noise or effects.shot_noise)
    return bool(
        any((*errors, *wind)) or scenario.state_noise != "none" or scenario.localizes or pictures
    )


def check_names(names: Iterable[str], known: Sequence[str], begins: str) -> None:
    """Checks the names of options.

    Args: names: that were given. known: that there are. begins: how the sentence begins.

    Raises:
        UserError: on the first that is unknown, with the nearest one and all that there are.
    """
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(name, known, 1)
            raise UserError(
                f"{begins} '{name}'{f', but {near[0]}' if near else ''}; "
                f"there are: {', '.join(known)}."
            )


def checked_options(options: Any) -> Mapping[str, Any]:
    """Returns the options of reset(), which may be None.

    Raises:
        UserError: if they are no mapping by names.
    """
    options = {} if options is None else options
    if not isinstance(options, Mapping) or not all(isinstance(name, str) for name in options):
        raise UserError(
            f"The options of reset() must be a dict by names, not {reprlib.repr(options)}."
        )
    return options
