"""The schemas of what a season leaves: league.json, flights.jsonl, and race.json of its races."""

import hashlib
import json
import re
from pathlib import Path
from typing import Any, Literal, NotRequired, TypedDict

from airrace.common.errors import UserError
from airrace.common.files import files_in
from airrace.common.json_files import parse_json, read_json

FORMAT = 2  # of league.json
NAME = r"\w[\w-]*"  # of an entry


class ResultJson(TypedDict):
    """race.json of a race of a league, as far as a league looks at it."""

    finished: bool
    dnf_reason: str | None
    laps: list[object]
    mean_lap_s: float | None
    best_lap_s: float | None
    collisions: int


class ConductJson(TypedDict):
    """How an entry behaved; without an entry that raced, attempts alone."""

    attempts: list[str]
    steps: NotRequired[int]
    missed_deadlines: NotRequired[int]
    longest_step_s: NotRequired[float]
    cpu_s: NotRequired[float]


class RowJson(TypedDict):
    """A line of flights.jsonl; see fly()."""

    key: str
    entry: str
    leg: int
    result: ResultJson
    sha256: str
    conduct: ConductJson


class EntryJson(TypedDict):
    """An entry that has flown."""

    entry: str
    team: str
    drone: str
    digest: str


class SettingsJson(TypedDict):
    """What must be equal for two seasons to be the same."""

    season: dict[str, object]
    season_sha256: str
    secret_sha256: str
    entries: list[EntryJson]
    refused: dict[str, str]
    versions: dict[str, object]
    safe: bool


class LegJson(TypedDict):
    """A race of the season."""

    leg: int
    level: int
    gates: int
    track_sha256: str


class FlightJson(TypedDict):
    """A race of an entry."""

    entry: str
    leg: int
    finished: bool
    dnf_reason: str | None
    laps: int
    mean_lap_s: float | None
    best_lap_s: float | None
    collisions: int
    conduct: ConductJson
    sha256: str


class LeagueJson(TypedDict):
    """league.json."""

    format: Literal[2]
    complete: bool
    settings: SettingsJson
    ranking: list[dict[str, object]]
    legs: list[LegJson]
    flights: list[FlightJson]
    files: dict[str, str]
    sha256: str


def read_league(path: Path) -> dict[str, Any]:
    """Returns what a league.json holds; raises UserError if it is none."""
    remedy = "name the league.json in the folder of a season that was flown"
    league: dict[str, Any] = dict(read_json(path, LeagueJson, "result of a league", remedy))
    for each in (*league["settings"]["entries"], *league["flights"]):
        if not re.fullmatch(NAME, each["entry"], re.ASCII):  # it becomes a path
            raise UserError(f"{path} is no result of a league: an entry's name is none; {remedy}.")
    for each in league["flights"]:
        if each["finished"] and None in (each["mean_lap_s"], each["best_lap_s"]):
            raise UserError(f"{path} is no result of a league: a race has no lap; {remedy}.")
    return league


def read_result(path: Path) -> dict[str, Any]:
    """Returns race.json of a league's race without ``wall``; raises UserError if it is none."""
    result: dict[str, Any] = dict(read_json(path, ResultJson, "race.json", "copy the folder anew"))
    result.pop("wall", None)
    return result


def read_rows(path: Path) -> list[dict[str, Any]]:
    """Returns the rows of flights.jsonl; raises UserError if it cannot be read or is none."""
    try:
        lines = path.read_bytes().splitlines()
        return [dict(parse_json(line, RowJson)) for line in lines]
    except (OSError, ValueError) as e:
        raise UserError(
            f"{path} is no file of a league's races: {e}; copy the folder anew."
        ) from None


def with_digests(league: dict[str, Any], folder: Path, own: str) -> dict[str, Any]:
    """Returns a league.json with the hashes of all other files of its folder, and of itself.

    Args: own: name of the file that is going to hold it.
    """
    files = {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files_in(folder)
        if path != folder / own
    }
    league = {**league, "files": files}
    return {**league, "sha256": league_digest(league)}


def league_digest(league: dict[str, Any]) -> str:
    """Returns the SHA-256 of all that a league.json holds but this hash."""
    rest = {name: value for name, value in league.items() if name != "sha256"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()
