"""Flies one race of a league on a worker of a cluster."""

import dataclasses as dc
import hashlib
import json

from pydrake.common.yaml import yaml_dump_typed

from airrace.evaluation.versions import versions
from airrace.evaluation.worker import (
    STOPPED,
    EndedRace,
    RaceRefused,
    check_versions,
    ended_race,
    read_json,
)
from airrace.league.entry import Entry
from airrace.league.entry_race import CONDUCT, LOG, REPLAY, RESULTS, SANDBOX
from airrace.league.sandbox import TOLD, SandboxConfig
from airrace.league.scenarios import ENTRY, SCENARIO, TRACK, Flown, make_flown
from airrace.league.season import Leg, Season

_TAIL = 4000  # bytes kept of what an entry wrote


@dc.dataclass(frozen=True)
class Flight:
    """One race of one entry, with all that a worker on another machine needs to fly it."""

    entry: str  # its name
    leg: int  # number of the race in the season
    flown: Flown  # the scenarios
    track: str  # YAML of the track
    files: dict[str, bytes]  # of the entry's folder, by relative names
    sandbox: SandboxConfig  # how the entry is held
    versions: dict  # see versions(); a worker with others does not fly the race

    @property
    def key(self) -> str:
        """Its name among all races of the season."""
        return f"{self.entry}-{self.leg}"

    def describe(self) -> str:
        """Returns what it is called in a sentence."""
        return f"race {self.leg} of {self.entry}"


def make_flight(
    season: Season, leg: Leg, entry: Entry, sandbox: SandboxConfig, flying: dict
) -> Flight:
    """Returns the race of an accepted entry on a leg of a season.

    Args: flying: see versions(); those that the race is to be flown with.
    """
    return Flight(
        entry=entry.name,
        leg=leg.number,
        flown=make_flown(season, leg, entry),
        track=leg.track,
        files=entry.files,
        sandbox=sandbox,
        versions=flying,
    )


def fly(flight: Flight, evaluation: str) -> dict:
    """Flies a race; returns its row of flights.jsonl with its files. evaluation: for stop_races().

    That is ``key``, ``entry``, ``leg``, ``result`` (race.json without ``wall``), ``sha256`` (of
    that, see result_digest()), ``conduct``, ``wall``, ``stderr`` and ``files`` (contents by name).
    Or ``key`` and ``refused``, why no such race can be flown here.

    Raises RaceKilled if it was killed from outside.
    """
    try:
        check_versions(flight.versions, versions({}))
        with ended_race("airrace.league.entry_race", _files(flight), evaluation, ends=(0,)) as race:
            return _row(flight, race)
    except RaceRefused as e:
        return {"key": flight.key, "refused": str(e)}


def result_digest(result: dict) -> str:
    """Returns the SHA-256 of race.json without ``wall``: the same whenever the race is flown."""
    return hashlib.sha256(json.dumps(result, sort_keys=True).encode()).hexdigest()


def _files(flight: Flight) -> dict[str, bytes]:
    """Returns what is in the folder of a race before it is flown: path to contents."""
    texts = {
        SCENARIO: flight.flown.scenario,
        TRACK: flight.track,
        SANDBOX: yaml_dump_typed(flight.sandbox, schema=SandboxConfig),
        f"{TOLD}/{SCENARIO}": flight.flown.entry_scenario,
        f"{TOLD}/{TRACK}": flight.flown.entry_track,
    }
    files = {f"{TOLD}/{ENTRY}/{name}": content for name, content in flight.files.items()}
    return files | {name: text.encode() for name, text in texts.items()}


def _row(flight: Flight, race: EndedRace) -> dict:
    """Returns the row of a race that was flown."""
    results, log = race.folder / RESULTS, race.folder / LOG
    if race.error:
        reason = f"the simulation was {STOPPED}{race.error.removeprefix(STOPPED)}"
        race.result.update(finished=False, dnf_reason=reason)
    kept = ("race.json", "race.mcap", "map.json", REPLAY, "scenario.yaml")
    files = {name: (results / name).read_bytes() for name in kept if (results / name).exists()}
    return {
        "key": flight.key,
        "entry": flight.entry,
        "leg": flight.leg,
        "result": race.result,
        "sha256": result_digest(race.result),
        "conduct": read_json(race.folder / CONDUCT) or {"attempts": []},
        "wall": race.wall,
        "stderr": race.stderr,
        "files": {**files, LOG: log.read_bytes()[-_TAIL:] if log.exists() else b""},
    }
