"""The folder of a season that was, or is being, flown, and league.json: all that it came to."""

import dataclasses as dc
import hashlib
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from airrace.common.errors import UserError
from airrace.common.files import files_in, finite, write_bytes, write_json
from airrace.evaluation.store import RaceStore
from airrace.league.entry import Entry
from airrace.league.league_json import FORMAT, RowJson, with_digests
from airrace.league.ranking import rank
from airrace.league.season import Leg, Season, season_digest, secret_digest

FLIGHTS, LEAGUE, PAGE = FILES = ("flights.jsonl", "league.json", "league.html")
SEASON = "season.yaml"  # a copy
ENTRIES, RACES, DUELS = "entries", "races", "duels"  # folders


class LeagueStore(RaceStore):
    """Keeps the rows of races in flights.jsonl; see RaceStore."""

    key = "key"
    files = FILES
    what = "league"
    row = RowJson


def race_folder(entry: str, leg: int) -> str:
    """Returns where the files of a race are, below the folder of the season."""
    return f"{RACES}/{entry}-{leg}"


def keep_sources(folder: Path, season: Path, entries: list[Entry]) -> None:
    """Copies the season's file and the entries: whoever has the folder can fly all again.

    Raises UserError if that cannot be done.
    """
    try:
        if season.resolve() != (folder / SEASON).resolve():
            shutil.copyfile(season, folder / SEASON)
        for entry in entries:
            for path in files_in(entry.folder):
                copy = folder / ENTRIES / entry.name / path.relative_to(entry.folder)
                if copy.resolve() != path.resolve():
                    copy.parent.mkdir(parents=True, exist_ok=True)
                    shutil.copyfile(path, copy)
    except OSError as e:
        raise UserError(
            f"The entries cannot be copied to {folder} ({e.strerror}); make room there."
        ) from None


def keep_files(folder: Path, row: dict[str, Any]) -> dict[str, Any]:
    """Writes the files that a race has left; returns its row without them."""
    files, place = row["files"], folder / race_folder(row["entry"], row["leg"])
    place.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        write_bytes(place / name, content)
    return {name: value for name, value in row.items() if name != "files"}


def settings(
    season: Season, secret: str, entries: Sequence[Entry], refused: dict[str, str], flown: dict
) -> dict:
    """Returns what must be equal for two seasons to be the same.

    Args:
        refused: names of those that do not, and why.
        flown: ``versions``, see versions(), and ``safe``, whether there was a sandbox.
    """
    return {
        "season": dc.asdict(season),
        "season_sha256": season_digest(season),
        "secret_sha256": secret_digest(secret),
        "entries": [
            {
                "entry": entry.name,
                "team": entry.config.team,
                "drone": entry.config.drone,
                "digest": entry.digest,
            }
            for entry in entries
        ],
        "refused": refused,
        **flown,
    }


def flight_lines(rows: Sequence[dict]) -> list[dict]:
    """Returns the lines of races in league.json; rows: of worker.fly()."""
    return [
        {
            "entry": row["entry"],
            "leg": row["leg"],
            **figures(row["result"]),
            "conduct": row["conduct"],
            "sha256": row["sha256"],
        }
        for row in rows
    ]


def make_league(settings: dict, legs: Sequence[Leg], lines: Sequence[dict]) -> dict:
    """Returns what league.json holds but for hashes.

    Args: settings: see there. lines: of all races that have been flown, see flight_lines().
    """
    names = [entry["entry"] for entry in settings["entries"]]
    flights = sorted(lines, key=lambda line: (names.index(line["entry"]), line["leg"]))
    flown = {(line["entry"], line["leg"]) for line in flights}
    return {
        "format": FORMAT,
        "complete": flown == {(name, leg.number) for name in names for leg in legs},
        "settings": settings,
        "ranking": ranking_of(names, flights, settings),
        "legs": [
            {
                "leg": leg.number,
                "level": leg.level,
                "gates": leg.gates,
                "track_sha256": hashlib.sha256(leg.track.encode()).hexdigest(),
            }
            for leg in legs
        ],
        "flights": flights,
    }


def write_league(folder: Path, league: dict) -> None:
    """Writes league.json, with the hashes of all other files of the folder and of its own.

    Args: league: of make_league().

    Raises UserError if it cannot be written.
    """
    write_json(folder / LEAGUE, with_digests(finite(league), folder, LEAGUE))


def ranking_of(names: Sequence[str], flights: Sequence[dict], settings: dict) -> list[dict]:
    """Returns the ranking as league.json has it."""
    standings = rank(names, flights, settings["season"]["rate_step"])
    return [dc.asdict(standing) for standing in standings]


def figures(result: dict) -> dict:
    """Returns the figures of a race that league.json repeats; result: race.json."""
    names = "finished", "dnf_reason", "laps", "mean_lap_s", "best_lap_s", "collisions"
    return {name: result[name] for name in names} | {"laps": len(result["laps"])}
