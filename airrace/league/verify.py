"""Checks a season's result, and says so on the terminal."""

import dataclasses as dc
from pathlib import Path

from rich.console import Console

from airrace.common.errors import UserError
from airrace.league import proof
from airrace.league.sandbox import SandboxConfig, check_sandbox, why_no_sandbox
from airrace.league.season import load_season, make_legs, read_secret
from airrace.league.season_files import SEASON
from airrace.league.worker import fly, make_flight


def verify_league(
    path: Path, seed_file: Path | None, chosen: tuple[str | None, int | None, bool], unsafe: bool
) -> int:
    """Compares all files, flies races again, and says what is wrong; returns the exit code.

    Args:
        seed_file: with the secret seed; None: where the season says.
        chosen: see proof.choose(): entry, race, and whether all.

    Raises UserError if it cannot be checked here.
    """
    folder, league = path.parent, proof.read_league(path)
    proof.check_versions(league)
    check_sandbox(unsafe)
    season = load_season(folder / SEASON)
    secret = _secret(folder, season, seed_file)
    again = proof.choose(league["flights"], *chosen)
    console = Console(stderr=True)
    with console.status("Comparing files"):
        legs = make_legs(season, secret)
        doubts = [*proof.check_season(league, season, secret, legs)]
        entries, of_entries = proof.load_flown_entries(folder, league)
        doubts += [*of_entries, *proof.check_files(folder, league)]
    for doubt in doubts:
        print(f"WRONG  {doubt.where}: {doubt.what}")
    if not doubts:
        print(f"right  all files of {len(league['flights'])} races agree")
    trusted = not any(doubt.where == "season" for doubt in doubts)
    for number, line in enumerate(again if trusted else [], 1):
        name = proof.describe(line)
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
        doubt = proof.compare(folder, line, row["result"])
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
