"""league.json: all that a season came to."""

import dataclasses as dc
import hashlib
from collections.abc import Sequence
from pathlib import Path

from airrace.common.files import write_json
from airrace.league.entry import Entry
from airrace.league.ranking import rank
from airrace.league.season import Leg, Season, season_digest, secret_digest
from airrace.league.season_files import LEAGUE

FORMAT = 1


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


def write_league(folder: Path, settings: dict, legs: Sequence[Leg], rows: Sequence[dict]) -> dict:
    """Writes league.json, and returns what it holds.

    Args: settings: see there. rows: of worker.fly(), of all races that have been flown.

    Raises UserError if it cannot be written.
    """
    names = [entry["entry"] for entry in settings["entries"]]
    lines = [
        {
            "entry": row["entry"],
            "leg": row["leg"],
            **figures(row["result"]),
            "conduct": row["conduct"],
            "sha256": row["sha256"],
        }
        for row in rows
    ]
    flights = sorted(lines, key=lambda line: (names.index(line["entry"]), line["leg"]))
    league = {
        "format": FORMAT,
        "complete": len(flights) == len(names) * len(legs),
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
    write_json(folder / LEAGUE, league)
    return league


def ranking_of(names: Sequence[str], flights: Sequence[dict], settings: dict) -> list[dict]:
    """Returns the ranking as league.json has it."""
    standings = rank(names, flights, settings["season"]["rate_step"])
    return [dc.asdict(standing) for standing in standings]


def figures(result: dict) -> dict:
    """Returns the figures of a race that league.json repeats; result: race.json."""
    names = "finished", "dnf_reason", "laps", "mean_lap_s", "best_lap_s", "collisions"
    return {name: result[name] for name in names} | {"laps": len(result["laps"])}
