"""A season: what is flown, by which rules, on tracks that nobody knows before."""

import contextlib
import dataclasses as dc
import hashlib
import math
from pathlib import Path

from pydrake.common.yaml import yaml_dump_typed

from airrace.common.errors import UserError
from airrace.common.resources import load_yaml
from airrace.common.words import printable
from airrace.evaluation.jobs import given_track
from airrace.math.random import derive
from airrace.scenario import TRUTH, VIO, load_scenario
from airrace.track import Track
from airrace.track.generator import GATE_COUNTS, generate_track
from airrace.vehicle import DRONES

_MIN_SECRET = 16  # characters
_ATTEMPTS = 100  # at a seed with a track
_DRONES = ("Default", "StarOne")
_LEVELS = (0, 1, 2, 3, 4)
_MAX_TRACKS = 1000


@dc.dataclass
class Limits:
    """What an entry may use, beyond which a step counts as late, or the race is over."""

    # s of processor time for one step of the link, about a millisecond of the race. More is a
    # missed deadline: it is counted and shown, and costs nothing.
    step_cpu: float = 0.1
    # s of processor time for one step, after which the race is over: an endless loop.
    step_cpu_end: float = 60.0
    # s by the wall's clock that the simulation waits for one step, and for all steps of a race
    # together, after which the race is over.
    step_wall: float = 120.0
    race_wall: float = 3600.0
    start_wall: float = 300.0  # s that the entry has from its start until it is ready to race
    memory: float = 4.0  # GB that its process may have
    disk: float = 0.25  # GB that it may write to its own /tmp, which is memory as well
    files: int = 20000  # that it may have there
    threads: int = 64  # that its process may have


@dc.dataclass
class Season:
    """What a season's YAML file says. Unknown keys are errors."""

    name: str = ""  # as the page calls it
    levels: list[int] = dc.field(default_factory=lambda: [2])  # of difficulty, see airrace race
    tracks: int = 10  # that are generated for each level
    gates: int | None = None  # of each track; by default, drawn for each
    track: str = ""  # a shipped track, or a file: then all races are on it, each with another seed
    laps: int = 3  # after exploring
    estimator: str = TRUTH  # what tells an entry where it is; or "vio": nothing does
    drones: list[str] = dc.field(default_factory=lambda: list(_DRONES))  # that entries may fly
    # A text that nobody can guess; tracks and noise follow from it. Relative to this file.
    seed_file: str = ""
    # Finish rates count as equal within steps of this size: the lower end of the 95 % interval
    # (Wilson) is rounded down to a multiple. Within a step, the mean lap decides.
    rate_step: float = 0.05
    limits: Limits = dc.field(default_factory=Limits)
    scenario_text: str = ""  # fields of the scenario on top of the level's, as YAML
    replays: bool = True  # whether each race leaves a page to look at

    def check(self, path: Path) -> None:
        """Raises UserError with one sentence on the first bad value; path: of its file."""
        for ok, sentence in (
            (self.name.strip(), "name must not be empty"),
            (self.name == printable(self.name), "name has characters that are not seen"),
            (self.levels, "levels must name at least one level"),
            (all(n in _LEVELS for n in self.levels), "levels must be numbers from 0 to 4"),
            (len({*self.levels}) == len(self.levels), "levels must name each level once"),
            (1 <= self.tracks <= _MAX_TRACKS, f"tracks must be from 1 to {_MAX_TRACKS}"),
            (1 <= self.laps <= 1000, "laps must be from 1 to 1000"),
            (self.estimator in (TRUTH, VIO), f"estimator must be {TRUTH} or {VIO}"),
            (
                self.drones and all(drone in DRONES for drone in self.drones),
                f"drones must be shipped ones: {', '.join(DRONES)}",
            ),
            (self.seed_file, "seed_file must name the file with the secret seed"),
            (0.0 < self.rate_step <= 1.0, "rate_step must be above 0 and at most 1"),
            (self.track == "" or self.gates is None, "gates is for generated tracks: leave it out"),
            (
                self.gates in (None, *GATE_COUNTS),
                f"gates must be one of {', '.join(map(str, GATE_COUNTS))}",
            ),
        ):
            if not ok:
                raise UserError(f"{path}: {sentence}.")
        for field in dc.fields(Limits):
            value = getattr(self.limits, field.name)
            if not 0.0 < value < math.inf:
                raise UserError(f"{path}: limits.{field.name} must be positive, not {value:g}.")
        load_scenario(scenario_text=self.scenario_text)


@dc.dataclass(frozen=True)
class Leg:
    """One race of a season, which every entry flies."""

    number: int  # from 1
    level: int  # of difficulty
    seed: int  # of all that is random in the race; a secret until the season is over
    track: str  # YAML of the track, which follows from another seed
    gates: int  # number of them


def load_season(path: Path) -> Season:
    """Returns a season from its file.

    Raises:
        UserError: naming the file and what is wrong.
    """
    if not path.is_file():
        raise UserError(
            f"There is no season {path}: name its YAML file; 'airrace new season NAME' makes one."
        )
    season = load_yaml(Season, filename=path)
    season.check(path)
    return season


def read_secret(path: Path, season: Season) -> str:
    """Returns the secret seed of a season, from the file that its own, at a path, names.

    Raises UserError if it cannot be read or is too short to be a secret.
    """
    file = path.parent / season.seed_file
    try:
        secret = file.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError):
        raise UserError(
            f"{path}: seed_file: {file} cannot be read; make it with a text that nobody can "
            "guess (python -c 'import secrets; print(secrets.token_hex(16))'), and keep it."
        ) from None
    if len(secret) < _MIN_SECRET:
        raise UserError(
            f"{file} must hold at least {_MIN_SECRET} characters that nobody can guess; "
            "python -c 'import secrets; print(secrets.token_hex(16))' prints some."
        )
    return secret


def season_digest(season: Season) -> str:
    """Returns a hash of all that a season says, not of how its file is laid out."""
    return hashlib.sha256(repr(season).encode()).hexdigest()


def secret_digest(secret: str) -> str:
    """Returns a hash that shows afterwards that the seed was not changed."""
    return hashlib.sha256(f"airrace league {secret}".encode()).hexdigest()


def make_legs(season: Season, secret: str) -> list[Leg]:
    """Returns all races of a season; the same for the same season and secret.

    Raises UserError if a track cannot be had.
    """
    legs = []
    for level in season.levels:
        for i in range(season.tracks):
            track, text = _draw_track(season, secret, f"level {level} track {i}")
            seed = derive(secret, f"race level {level} track {i}")
            legs.append(Leg(len(legs) + 1, level, seed, text, len(track.gates)))
    return legs


def _draw_track(season: Season, secret: str, name: str) -> tuple[Track, str]:
    """Returns the track of a race and its YAML.

    It does not follow from the race's seed: entries see what that draws.
    """
    if season.track:
        return given_track(season.track)
    for attempt in range(_ATTEMPTS):
        with contextlib.suppress(UserError):  # there is none with this seed
            track = generate_track(derive(secret, f"{name} attempt {attempt}"), season.gates)
            track = dc.replace(track, name=name.replace(" ", "-"))
            return track, yaml_dump_typed(track, schema=Track)
    raise UserError(
        f"No track of {season.gates} gates could be made; take another number of gates."
    )
