"""Can a result be trusted? What is in a season's folder is compared, and races are flown again.

A race is a function of its scenario, its seed, the entry's files and the versions of what flies
it. So nobody needs to believe a lap time: flown again, it must come out equal to the last bit.
"""

import dataclasses as dc
import hashlib
import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console

from airrace.common.errors import UserError
from airrace.evaluation.store import first_difference
from airrace.evaluation.versions import mismatch, versions
from airrace.league.entry import Entry, load_entry
from airrace.league.sandbox import SandboxConfig, check_sandbox, why_no_sandbox
from airrace.league.season import (
    Leg,
    Season,
    load_season,
    make_legs,
    read_secret,
    season_digest,
    secret_digest,
)
from airrace.league.season_files import ENTRIES, FORMAT, SEASON, figures, race_folder, ranking_of
from airrace.league.worker import fly, make_flight, result_digest


class Doubt(NamedTuple):
    """Something that is not as it should be."""

    where: str  # what is wrong: an entry, a race, the season
    what: str  # a clause on what is wrong


def verify_league(
    path: Path, seed_file: Path | None, chosen: tuple[str | None, int | None, bool], unsafe: bool
) -> int:
    """Compares all files, flies races again, and says what is wrong; returns the exit code.

    Args:
        seed_file: with the secret seed; None: where the season says.
        chosen: see choose(): entry, race, and whether all.

    Raises UserError if it cannot be checked here.
    """
    folder, league = path.parent, read_league(path)
    check_versions(league)
    check_sandbox(unsafe)
    season = load_season(folder / SEASON)
    secret = _secret(folder, season, seed_file)
    again = choose(league["flights"], *chosen)
    console = Console(stderr=True)
    with console.status("Comparing files"):
        legs = make_legs(season, secret)
        doubts = [*check_season(league, season, secret, legs)]
        entries, of_entries = load_flown_entries(folder, league)
        doubts += [*of_entries, *check_files(folder, league)]
    for doubt in doubts:
        print(f"WRONG  {doubt.where}: {doubt.what}")
    if not doubts:
        print(f"right  all files of {len(league['flights'])} races agree")
    trusted = not any(doubt.where == "season" for doubt in doubts)
    for number, line in enumerate(again if trusted else [], 1):
        name = describe(line)
        if line["entry"] not in entries:
            continue
        leg = legs[line["leg"] - 1]
        entry = entries[line["entry"]]
        sandbox = SandboxConfig(safe=why_no_sandbox() is None, replay=False, limits=season.limits)
        flight = make_flight(season, leg, entry, sandbox, league["settings"]["versions"])
        with console.status(f"Flying {name} again ({number} of {len(again)})"):
            row = fly(flight, "verify")
        if "refused" in row:
            raise UserError(f"The {name} was refused: {row['refused']}")
        doubt = compare(folder, line, row["result"])
        if doubt is None:
            print(f"right  {name}, flown again, is equal to the last bit", flush=True)
        else:
            print(f"WRONG  {doubt.where}: {doubt.what}", flush=True)
            doubts.append(doubt)
    return 1 if doubts else 0


def _secret(folder, season, seed_file):
    """Returns the secret seed, from the file that is named or where the season's file may be."""
    if seed_file is not None:
        named = dc.replace(season, seed_file=str(seed_file.resolve()))
        return read_secret(Path("--seed_file"), named)
    for place in (folder, Path()):
        if (place / season.seed_file).is_file():
            return read_secret(place / SEASON, season)
    raise UserError(
        "Races cannot be flown again without the season's secret seed; name its file by "
        "--seed_file."
    )


def read_league(path: Path) -> dict[str, Any]:
    """Returns what a league.json holds; raises UserError if it is none."""
    try:
        league = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise UserError(
            f"{path} cannot be read as a league's result; name the league.json in the folder of a "
            "season."
        ) from None
    keys = {"format", "settings", "ranking", "legs", "flights"}
    if not isinstance(league, dict) or league.get("format") != FORMAT or not keys <= league.keys():
        raise UserError(f"{path} is no result of a league; name the league.json of a season.")
    return league


def check_versions(league: dict) -> None:
    """Raises UserError if races flown here could not be compared: with other code, others come."""
    differs = mismatch(league["settings"]["versions"], versions({}))
    if differs:
        raise UserError(
            f"This computer has {differs}: races would differ; install the versions that the "
            "season was flown with."
        )


def check_season(league: dict, season: Season, secret: str, legs: Sequence[Leg]) -> Iterator[Doubt]:
    """Yields what of the season is not as league.json says."""
    settings = league["settings"]
    if season_digest(season) != settings["season_sha256"]:
        yield Doubt("season", "season.yaml is not the one that was flown")
    if secret_digest(secret) != settings["secret_sha256"]:
        yield Doubt("season", "the secret seed is not the one that was flown")
        return
    for leg, line in zip(legs, league["legs"]):
        if hashlib.sha256(leg.track.encode()).hexdigest() != line["track_sha256"]:
            yield Doubt(f"race {leg.number}", "its track is not the one that the seed gives")


def load_flown_entries(folder: Path, league: dict) -> tuple[dict[str, Entry], list[Doubt]]:
    """Returns the entries in a season's folder by name, and doubts about them."""
    entries, doubts = {}, []
    for line in league["settings"]["entries"]:
        name = line["entry"]
        try:
            entries[name] = load_entry(folder / ENTRIES / name)
        except UserError as e:
            doubts.append(Doubt(f"entry {name}", str(e)))
            continue
        if entries[name].digest != line["digest"]:
            doubts.append(Doubt(f"entry {name}", "its files are not those that were flown"))
    return entries, doubts


def check_files(folder: Path, league: dict) -> Iterator[Doubt]:
    """Yields what does not agree within a season's folder, without flying."""
    for line in league["flights"]:
        where = describe(line)
        path = folder / race_folder(line["entry"], line["leg"]) / "race.json"
        try:
            result = read_result(path)
            repeated = figures(result)
        except (OSError, ValueError, LookupError, TypeError):
            yield Doubt(where, f"its race.json is missing or broken: {path}")
            continue
        if result_digest(result) != line["sha256"]:
            yield Doubt(where, "its race.json has another hash than league.json says")
        for name, value in repeated.items():
            if line[name] != value:
                yield Doubt(where, f"{name} is {line[name]} in league.json, {value} in race.json")
    names = [line["entry"] for line in league["settings"]["entries"]]
    if ranking_of(names, league["flights"], league["settings"]) != league["ranking"]:
        yield Doubt("ranking", "it does not follow from the races")


def compare(folder: Path, line: dict, result: dict) -> Doubt | None:
    """Returns a doubt if a race, flown again, is another one than league.json says.

    Args:
        line: of the race in league.json.
        result: race.json without ``wall``, of the race flown again.
    """
    if result_digest(result) == line["sha256"]:
        return None
    try:
        before = read_result(folder / race_folder(line["entry"], line["leg"]) / "race.json")
    except (OSError, ValueError):
        before = {}
    difference = first_difference(before, json.loads(json.dumps(result)))
    if difference is None:
        return Doubt(describe(line), "flown again, it has another hash than league.json says")
    name, old, new = difference
    return Doubt(describe(line), f"flown again, {name} is {_short(new)}, not {_short(old)}")


def read_result(path: Path) -> dict[str, Any]:
    """Returns race.json without ``wall``; raises OSError or ValueError if that cannot be."""
    result = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(result, dict):
        raise ValueError("it is no object")
    result.pop("wall", None)
    return result


def choose(flights: Iterable[dict], entry: str | None, leg: int | None, every: bool) -> list[dict]:
    """Returns which races of league.json to fly again.

    Args:
        entry, leg: only that entry's, and only that race; None: any.
        every: whether all of them, else of each entry the one with the quickest mean lap.

    Raises UserError if there is none.
    """
    chosen = [
        line for line in flights if entry in (None, line["entry"]) and leg in (None, line["leg"])
    ]
    if not chosen:
        raise UserError("The season has no such race: see --entry and --race.")
    if every or leg is not None:
        return chosen
    best: dict[str, dict] = {}
    for line in sorted(chosen, key=lambda each: (not each["finished"], each["mean_lap_s"] or 0.0)):
        best.setdefault(line["entry"], line)
    return list(best.values())


def describe(line: dict) -> str:
    """Returns what a race of league.json is called."""
    return f"race {line['leg']} of {line['entry']}"


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
