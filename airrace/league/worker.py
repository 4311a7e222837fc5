"""Flies one race of a league on a worker of a cluster."""

import dataclasses as dc
import hashlib
import json
import tempfile
from pathlib import Path

from pydrake.common.yaml import yaml_dump_typed

from airrace.evaluation.versions import mismatch, versions
from airrace.evaluation.worker import NO_RESULT, RaceKilled, run_process, was_killed
from airrace.league.entry import Entry
from airrace.league.entry_race import CONDUCT, LOG, REPLAY, RESULTS, SANDBOX
from airrace.league.sandbox import TOLD, SandboxConfig
from airrace.league.scenarios import ENTRY, SCENARIO, TRACK, Flown, make_flown
from airrace.league.season import Leg, Season

_TAIL = 4000  # characters kept of what a race wrote that was stopped by an error


@dc.dataclass(frozen=True)
class Flight:
    """One race of one entry, with all that a worker on another machine needs to fly it.

    Attributes:
        entry: its name.
        leg: number of the race in the season.
        flown: the scenarios.
        track: YAML of the track.
        files: of the entry's folder, by relative names.
        sandbox: how the entry is held.
        versions: see versions(); a worker with others does not fly the race.
    """

    entry: str
    leg: int
    flown: Flown
    track: str
    files: dict[str, bytes]
    sandbox: SandboxConfig
    versions: dict

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
    """Returns the race of an entry on a leg of a season.

    Args:
        season: the rules.
        leg: of the season.
        entry: an accepted one.
        sandbox: how it is held.
        flying: see versions(); those that the race is to be flown with.
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
    """Flies a race and returns its row of flights.jsonl, and the files that it leaves.

    Args:
        flight: the race.
        evaluation: a name for stop_races().

    Returns:
        ``key``, ``entry``, ``leg``, ``result`` (race.json without ``wall``), ``sha256`` (of that,
        see result_digest()), ``conduct``, ``wall``, ``stderr`` and ``files`` (contents by name).
        Or ``key`` and ``refused``, why no such race can be flown here.

    Raises:
        RaceKilled: if it was killed from outside.
    """
    differs = mismatch(flight.versions, versions({}))
    if differs:
        return {"key": flight.key, "refused": f"a worker has {differs}; give all the same."}
    with tempfile.TemporaryDirectory(prefix="airrace-", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        _write_files(folder, flight)
        code = run_process("airrace.league.entry_race", folder, evaluation)
        stderr = (folder / "stderr").read_text("utf-8", errors="replace").strip()
        return _row(flight, code, stderr, folder)


def result_digest(result: dict) -> str:
    """Returns the SHA-256 of race.json without ``wall``: the same whenever the race is flown."""
    return hashlib.sha256(json.dumps(result, sort_keys=True).encode()).hexdigest()


def _write_files(folder: Path, flight: Flight) -> None:
    told = folder / TOLD
    (told / ENTRY).mkdir(parents=True)
    for path, text in (
        (folder / SCENARIO, flight.flown.scenario),
        (folder / TRACK, flight.track),
        (folder / SANDBOX, yaml_dump_typed(flight.sandbox, schema=SandboxConfig)),
        (told / SCENARIO, flight.flown.entry_scenario),
        (told / TRACK, flight.flown.entry_track),
    ):
        path.write_text(text, encoding="utf-8")
    for name, content in flight.files.items():
        path = told / ENTRY / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


def _row(flight: Flight, code: int, stderr: str, folder: Path) -> dict:
    """Returns the row of a race whose process has ended with an exit code."""
    if code == 2:
        said = stderr.removeprefix("airrace: ") or "no reason given"
        return {"key": flight.key, "refused": said}
    result = _read(folder / RESULTS / "race.json") or dict(NO_RESULT)
    wall, reason, error = result.pop("wall", None), result["dnf_reason"], None
    if reason == "interrupted" or was_killed(code):
        raise RaceKilled("its process was killed")
    if code != 0 or (reason in (None, "not over yet") and not result["finished"]):
        error = (stderr.splitlines() or ["nothing was said"])[-1].strip()
        result.update(finished=False, dnf_reason=f"the simulation was stopped by an error: {error}")
    files = {}
    for name in ("race.json", "race.mcap", "map.json", REPLAY, "scenario.yaml"):
        if (folder / RESULTS / name).exists():
            files[name] = (folder / RESULTS / name).read_bytes()
    log = folder / LOG
    files[LOG] = log.read_bytes()[-_TAIL:] if log.exists() else b""
    return {
        "key": flight.key,
        "entry": flight.entry,
        "leg": flight.leg,
        "result": result,
        "sha256": result_digest(result),
        "conduct": _read(folder / CONDUCT) or {"attempts": []},
        "wall": wall,
        "stderr": stderr[-_TAIL:] if error else None,
        "files": files,
    }


def _read(path: Path) -> dict | None:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
