"""The folder of a season that was, or is being, flown."""

import shutil
from pathlib import Path
from typing import Any

from airrace.common.errors import UserError
from airrace.common.files import files_in, write_bytes
from airrace.evaluation.store import RaceStore
from airrace.league.entry import Entry

FLIGHTS, LEAGUE, PAGE = FILES = ("flights.jsonl", "league.json", "league.html")
SEASON = "season.yaml"  # a copy
ENTRIES, RACES, DUELS = "entries", "races", "duels"  # folders


class LeagueStore(RaceStore):
    """Keeps the rows of races in flights.jsonl; see RaceStore."""

    key = "key"
    files = FILES
    what = "league"


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
