"""The schema of race.json: what its readers rely on, and how to read it."""

from pathlib import Path
from typing import NotRequired, TypedDict

from airrace.common.errors import UserError
from airrace.common.json_files import read_json

_WHAT, _REMEDY = "race.json", "name the folder that a race left, such as runs/<time>-..."


class PlanJson(TypedDict):
    """The plan of a lap; see plan_data() for the rest."""

    number: int
    duration_s: float
    rotor_factors: NotRequired[list[float]]
    drag: NotRequired[list[float]]
    wind: NotRequired[list[float]]


class LapJson(TypedDict):
    """A lap that was completed."""

    lap: int  # from 1
    start_s: float
    time_s: float
    waited_s: NotRequired[float]  # by how much the clock of plans waited for the drone, if it did
    gate_times_s: list[float]  # of all gates, since gate 1
    gate_offsets_m: list[float]  # of all gates, from their midpoints
    max_speed: float
    map_rms_m: float | None
    plan: PlanJson | None


class EventJson(TypedDict):
    """A state that the explorer entered."""

    time_s: float
    state: str
    reason: str


class ExplorationJson(TypedDict):
    """How the search for the gates went."""

    success: bool
    time_s: float
    gates_found: int
    events: list[EventJson]


class WallJson(TypedDict):
    """What depends on the computer, and more."""

    simulation: str
    date: NotRequired[str]  # of its end, ISO 8601, UTC
    version: NotRequired[str]  # of airrace
    plan_solve_times_s: NotRequired[list[float | None]]
    link: NotRequired[dict[str, object]]  # of a client's flight: its counters


class RaceJson(TypedDict):
    """race.json, as RaceResult.data() makes it."""

    track: str
    drone: str
    trajectory: str
    limits: str
    seed: int
    finished: bool
    dnf_reason: str | None
    exploration: ExplorationJson
    systems: NotRequired[dict[str, str]]  # of one's own: the name of each to module:callable
    laps: list[LapJson]
    mean_lap_s: float | None
    best_lap_s: float | None
    collisions: int
    negative_thrusts: NotRequired[int]  # that a controller of one's own asked for
    wall: WallJson


class CourseJson(TypedDict):
    """race.json of a client's flight, as CourseResult.data() makes it."""

    track: str
    drone: str
    seed: int
    vq: int
    finished: bool
    dnf_reason: str | None
    start_s: float | None
    gates: int
    gates_passed: int
    time_s: float | None
    wall: WallJson


class _AnyJson(TypedDict):
    """race.json of either kind."""

    vq: NotRequired[object]


def is_course_json(path: Path) -> bool:
    """Returns whether a race.json is of a client's flight; raises UserError if it is none."""
    return "vq" in read_json(path, _AnyJson, _WHAT, _REMEDY)


def check_run(path: Path) -> None:
    """Raises UserError unless there is a race.json in a folder, or beside a file."""
    is_course_json((path.parent if path.is_file() else path) / "race.json")


def read_course_json(path: Path) -> CourseJson:
    """Returns what the race.json of a client's flight holds; raises UserError as below."""
    return read_json(path, CourseJson, _WHAT, _REMEDY)


def read_race_json(path: Path) -> RaceJson:
    """Returns what a race.json holds.

    Raises:
        UserError: naming the first of its fields that is not as races leave it.
    """
    race = read_json(path, RaceJson, _WHAT, _REMEDY)
    if wrong := _contradiction(race):
        raise UserError(f"{path} is no {_WHAT}: {wrong}; {_REMEDY}.")
    return race


def _contradiction(race: RaceJson) -> str | None:
    """Returns a clause on fields that do not fit to one another, or None."""
    laps = race["laps"]
    gates = len(laps[0]["gate_times_s"]) if laps else 0
    for i, lap in enumerate(laps):
        if lap["lap"] != i + 1:
            return f"laps[{i}].lap is {lap['lap']}, expected {i + 1}"
        for name in ("gate_times_s", "gate_offsets_m"):
            if not len(lap[name]) == gates > 0:
                return f"laps[{i}].{name} must have a number for each gate"
        times = [*lap["gate_times_s"], lap["time_s"]]
        if times != sorted(times) or lap["time_s"] <= 0.0:
            return f"laps[{i}]: its gates were not passed one after another"
    for name in ("mean_lap_s", "best_lap_s"):
        if (race[name] is None) == bool(laps):  # type: ignore[literal-required]
            return f"{name} does not fit {len(laps)} laps"
    return None
