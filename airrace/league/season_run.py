"""What a season flies: every accepted entry on every track."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from airrace.common.errors import UserError
from airrace.common.words import printable
from airrace.evaluation.versions import versions
from airrace.league.entry import Entry, find_entry, load_entry
from airrace.league.sandbox import SandboxConfig
from airrace.league.scenarios import make_flown
from airrace.league.season import Leg, Season, load_season, make_legs, read_secret
from airrace.league.worker import Flight, make_flight


class Plan(NamedTuple):
    """All that is to be flown."""

    season: Season  # the rules
    secret: str  # its seed
    entries: list[Entry]  # that are accepted
    refused: dict[str, str]  # names, or folders, of those that are not, and why
    legs: list[Leg]  # the races
    flights: list[Flight]  # of all entries


def make_plan(season_file: Path, names: Sequence[str | Path], safe: bool) -> Plan:
    """Returns what is to be flown. An entry that is not accepted keeps no other from flying.

    Args: names: of shipped entries, or folders. safe: whether entries are in a sandbox.

    Raises UserError if the season is not sound, or no entry is.
    """
    season = load_season(season_file)
    secret = read_secret(season_file, season)
    legs = make_legs(season, secret)
    entries, refused = _accepted(names, lambda entry: make_flown(season, legs[0], entry))
    if not entries:
        raise UserError(f"No entry is accepted. {' '.join(refused.values())}")
    sandbox = SandboxConfig(safe=safe, replay=season.replays, limits=season.limits)
    flying = versions({})
    flights = [
        make_flight(season, leg, entry, sandbox, flying)
        for leg in legs  # all entries on one track after another: an early look is fair
        for entry in entries
    ]
    return Plan(season, secret, entries, refused, legs, flights)


def _accepted(
    names: Sequence[str | Path], check: Callable[[Entry], object]
) -> tuple[list[Entry], dict[str, str]]:
    entries: dict[str, Entry] = {}
    refused = {}
    for name in names:
        find_entry(name)  # a name that is mistyped ends the season before it is flown
        try:
            entry = load_entry(name)
            check(entry)
        except UserError as e:
            refused[printable(Path(name).resolve().name)] = str(e)
            continue
        if entry.name in entries:
            raise UserError(
                f"Two entries are called {entry.name}: {entries[entry.name].folder} and "
                f"{entry.folder}; give one folder another name."
            )
        entries[entry.name] = entry
    return list(entries.values()), refused
