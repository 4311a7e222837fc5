"""Can a result be trusted? What is in a season's folder is compared, and races are flown again.

A race is a function of its scenario, its seed, the entry's files and the versions of what flies
it. So nobody needs to believe a lap time: flown again, it must come out equal to the last bit.
"""

import dataclasses as dc
import json
import secrets
from collections.abc import Iterable
from pathlib import Path

from rich.console import Console

from airrace.common.errors import UserError
from airrace.evaluation.store import first_difference
from airrace.evaluation.versions import mismatch, versions
from airrace.league.folder_check import (
    Doubt,
    check_digests,
    check_flights,
    check_season,
    check_whole,
    describe,
    load_flown_entries,
    short,
)
from airrace.league.league_json import read_league, read_result
from airrace.league.sandbox import SandboxConfig, check_sandbox, why_no_sandbox
from airrace.league.season import load_season, make_legs, read_secret
from airrace.league.season_files import SEASON, race_folder
from airrace.league.worker import fly, make_flight, result_digest


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
        other_season = [*check_season(league, season, secret)]
        legs = [] if other_season else make_legs(season, secret)
        entries, doubts = load_flown_entries(folder, league)
        doubts += [*other_season, *check_digests(folder, league), *check_flights(folder, league)]
        if not other_season:
            doubts += check_whole(league, season, secret, legs, entries)
    for doubt in doubts:
        print(f"WRONG  {doubt.where}: {doubt.what}")
    if not doubts:
        print(f"right  all files of {len(league['flights'])} races agree")
    if not league["complete"]:
        print("note   the season is not complete: not all entries have flown all races")
    print(f"note   league.json was written with the hash {league['sha256']}")
    for number, line in enumerate(again, 1):
        name = describe(line)
        if line["entry"] not in entries or not 1 <= line["leg"] <= len(legs):
            continue  # a doubt says so
        leg = legs[line["leg"] - 1]
        entry = entries[line["entry"]]
        sandbox = SandboxConfig(safe=why_no_sandbox() is None, replay=False, limits=season.limits)
        flight = make_flight(season, leg, entry, sandbox, league["settings"]["versions"])
        with console.status(f"Flying {name} again ({number} of {len(again)})"):
            row = fly(flight, "verify")
        if "refused" in row:
            raise UserError(f"The {name} was refused: {row['refused']}")
        doubt = compare(folder, line, row)
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


def check_versions(league: dict) -> None:
    """Raises UserError if races flown here could not be compared: with other code, others come."""
    differs = mismatch(league["settings"]["versions"], versions({}))
    if differs:
        raise UserError(
            f"This computer has {differs}: races would differ; install the versions that the "
            "season was flown with."
        )


def compare(folder: Path, line: dict, row: dict) -> Doubt | None:
    """Returns a doubt if a race, flown again, is another one than league.json says.

    Args:
        line: of the race in league.json.
        row: of the race flown again, see fly().
    """
    result = row["result"]
    if result_digest(result) == line["sha256"]:
        # What it tried may have names that are drawn anew each time.
        if bool(row["conduct"]["attempts"]) != bool(line["conduct"]["attempts"]):
            return Doubt(describe(line), "flown again, it tries other things that it must not")
        return None
    try:
        before = read_result(folder / race_folder(line["entry"], line["leg"]) / "race.json")
    except UserError:
        before = {}
    difference = first_difference(before, json.loads(json.dumps(result)))
    if difference is None:
        return Doubt(describe(line), "flown again, it has another hash than league.json says")
    name, old, new = difference
    return Doubt(describe(line), f"flown again, {name} is {short(new)}, not {short(old)}")


def choose(flights: Iterable[dict], entry: str | None, leg: int | None, every: bool) -> list[dict]:
    """Returns which races of league.json to fly again.

    Args:
        entry, leg: only that entry's, and only that race; None: any.
        every: whether all of them, else of each entry the one with the quickest mean lap, and one
            of the others that is drawn at random.

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
    again = list(best.values())
    others = [line for line in chosen if line not in again]
    return [*again, secrets.choice(others)] if others else again
