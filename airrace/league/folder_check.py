"""Does all that a season's folder shows follow from its entries, its rules and its secret?

Nothing is flown for this. What does not follow, such as how an entry behaved, or what a replay
shows, is covered by the hashes that league.json has of all files and of itself.
"""

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from airrace.common.errors import UserError
from airrace.evaluation.store import first_difference
from airrace.evaluation.versions import versions
from airrace.league.entry import Entry, load_entry
from airrace.league.league_json import (
    FlightJson,
    league_digest,
    read_result,
    read_rows,
    with_digests,
)
from airrace.league.season import Leg, Season, season_digest, secret_digest
from airrace.league.season_files import (
    ENTRIES,
    FLIGHTS,
    LEAGUE,
    figures,
    make_league,
    race_folder,
    settings,
)
from airrace.league.worker import result_digest

_SEALS = "files", "sha256"  # see check_digests()


class Doubt(NamedTuple):
    """Something that is not as it should be."""

    where: str  # what is wrong: an entry, a race, the season
    what: str  # a clause on what is wrong


def describe(line: Mapping) -> str:
    """Returns what a race of league.json is called."""
    return f"race {line['leg']} of {line['entry']}"


def check_digests(folder: Path, league: dict[str, Any]) -> Iterator[Doubt]:
    """Yields which files are not those that league.json was written with."""
    if league_digest(league) != league["sha256"]:
        yield Doubt(LEAGUE, "it has another hash than it says")
    there = with_digests(league, folder, LEAGUE)["files"]
    for name in sorted({*there, *league["files"]}):
        if name not in there:
            yield Doubt(f"file {short(name)}", "it is gone")
        elif name not in league["files"]:
            yield Doubt(f"file {short(name)}", "it is none of the season's")
        elif there[name] != league["files"][name]:
            yield Doubt(f"file {short(name)}", "it has another hash than league.json says")


def check_season(league: dict, season: Season, secret: str) -> Iterator[Doubt]:
    """Yields a doubt if the rules or the secret are not those that were flown."""
    told = league["settings"]
    if season_digest(season) != told["season_sha256"]:
        yield Doubt("season", "season.yaml is not the one that was flown")
    if secret_digest(secret) != told["secret_sha256"]:
        yield Doubt("season", "the secret seed is not the one that was flown")


def load_flown_entries(folder: Path, league: dict) -> tuple[dict[str, Entry], list[Doubt]]:
    """Returns the entries in a season's folder by name, and doubts about them."""
    entries, doubts = {}, []
    names = [line["entry"] for line in league["settings"]["entries"]]
    for name in sorted(path.name for path in (folder / ENTRIES).glob("*")):
        if names.count(name) != 1:
            doubts.append(Doubt(f"entry {name}", "league.json must name it once"))
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


def check_flights(folder: Path, league: dict) -> Iterator[Doubt]:
    """Yields in which races league.json, flights.jsonl and race.json do not agree."""
    try:
        rows = {(row["entry"], row["leg"]): row for row in read_rows(folder / FLIGHTS)}
    except UserError as e:
        yield Doubt(FLIGHTS, str(e))
        return
    lines = [(line["entry"], line["leg"]) for line in league["flights"]]
    for (entry, leg), count in (Counter(lines) - Counter(rows.keys())).items():
        yield Doubt(
            f"race {leg} of {entry}", f"league.json has it {count} times more than {FLIGHTS}"
        )
    for entry, leg in rows.keys() - set(lines):
        yield Doubt(f"race {leg} of {entry}", "league.json leaves it out")
    for line in league["flights"]:
        where, row = describe(line), rows.get((line["entry"], line["leg"]))
        path = folder / race_folder(line["entry"], line["leg"]) / "race.json"
        try:
            result = read_result(path)
        except UserError:
            yield Doubt(where, f"its race.json is missing or broken: {path}")
            continue
        if result_digest(result) != line["sha256"]:
            yield Doubt(where, "its race.json has another hash than league.json says")
        if row is not None and (row["result"], row["sha256"]) != (result, line["sha256"]):
            yield Doubt(where, f"its race.json is not the one of {FLIGHTS}")
        for name, value in figures(result).items():
            if line[name] != value:
                told, found = short(line[name]), short(value)
                yield Doubt(where, f"{name} is {told} in league.json, {found} in race.json")
        if row is not None and row["conduct"] != line["conduct"]:
            yield Doubt(where, f"conduct is not that of {FLIGHTS}")


def check_whole(
    league: dict, season: Season, secret: str, legs: Sequence[Leg], entries: dict[str, Entry]
) -> Iterator[Doubt]:
    """Yields what else in league.json does not follow from entries, rules, secret and flights.

    Args: entries: by name, those that the season's folder has.
    """
    for line in league["flights"]:
        if line["entry"] not in entries or not 1 <= line["leg"] <= len(legs):
            yield Doubt(describe(line), "the season has no such race")
            return
        if beyond := line.keys() - FlightJson.__annotations__.keys():
            yield Doubt(describe(line), f"no race has {', '.join(sorted(beyond))}")
    told = league["settings"]
    if unsaid := versions({}).keys() - told["versions"].keys():
        yield Doubt("settings", f"versions does not say that of {', '.join(sorted(unsaid))}")
    own = [entries[line["entry"]] for line in told["entries"] if line["entry"] in entries]
    flown = {"versions": told["versions"], "safe": told["safe"]}
    follows = settings(season, secret, own, told["refused"], flown)
    # As JSON has it: tuples are lists.
    expected = json.loads(json.dumps(make_league(follows, legs, league["flights"])))
    for name in {**expected, **league}:
        told, follows = (each.get(name, "nothing") for each in (league, expected))
        if name not in _SEALS and (difference := first_difference(told, follows, name)):
            place, old, new = difference
            yield Doubt(name, f"{place} is {short(old)}, where {short(new)} follows")


def short(value: Any) -> str:
    """Returns plain data in a few characters of ASCII."""
    text = json.dumps(value, default=repr)
    return text if len(text) <= 60 else f"{text[:57]}..."
