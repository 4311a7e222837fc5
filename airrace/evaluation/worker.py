"""Flies one race on a worker, in a process of its own.

A Drake diagram with Python systems is never freed, and what crashes one race
must not end the others. The process is what somebody who flies that race alone
would start, so that the results are the same.
"""

import collections
import contextlib
import dataclasses as dc
import json
import os
import subprocess
import tempfile
import threading
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from airrace.common.processes import ONE_THREAD, signal_name
from airrace.common.python_path import module_command, own_systems_folder
from airrace.common.words import printable
from airrace.evaluation.versions import mismatch, versions

# What is in the folder of one race; evaluation/race_process.py flies it.
SCENARIO, TRACK, DRONE, RESULTS = "scenario.yaml", "track.yaml", "drone", "results"
_KILLS = ("SIGHUP", "SIGINT", "SIGKILL", "SIGTERM")
# Why a race ended whose process was stopped by an error: None if it left no race.json.
_NO_REASONS = (None, "stopped by an error", "not over yet")
STOPPED = "stopped by an error: "  # begins EndedRace.error, unless it crashed
_TAIL = 4000  # characters kept of what a crashed race wrote
NO_RESULT: dict = {
    "finished": False,
    "dnf_reason": None,
    "exploration": {"success": False, "time_s": None, "gates_found": 0},
    "laps": [],
    "mean_lap_s": None,
    "best_lap_s": None,
    "collisions": 0,
}

_lock = threading.Lock()
_running = collections.defaultdict(set)  # evaluation to the processes of its races here
_stopped = set()  # evaluations


@dc.dataclass(frozen=True)
class RaceJob:
    """One race, with all that a worker on another machine needs to fly it."""

    seed: int  # of the race and, if it was generated, of the track
    track: str  # YAML of the track
    gates: int  # number of them
    length: float  # of the polygon through the gates' midpoints (m)
    scenario: str  # a scenario file; its track is not used
    # Contents of the files of the drone's folder by relative names; empty for a shipped drone
    drone: dict
    systems: dict  # of the scenario
    versions: dict  # see versions(); a worker with others does not fly the race

    @property
    def key(self) -> int:
        """The seed: what tells it from the other races of an evaluation."""
        return self.seed

    def describe(self) -> str:
        """Returns what it is called in a sentence."""
        return f"race with seed {self.seed}"


class RaceKilled(Exception):
    """The race's process was killed from outside; the race is to be flown again."""


class EndedRace(NamedTuple):
    """A race whose process has ended."""

    folder: Path  # of its files
    result: dict  # race.json without ``wall``
    wall: dict | None  # of race.json, or None
    error: str | None  # a clause on what stopped it, unless it ended as races do
    stderr: str | None  # the end of what it wrote if so, else None


class RaceRefused(Exception):
    """No such race can be flown here; the message says why."""


def fly(job: RaceJob, evaluation: str) -> dict:
    """Flies a race and returns its row of races.jsonl; evaluation: a name for stop_races().

    That is ``seed``, ``gates``, ``length_m``, ``result`` (race.json without ``wall``), ``stderr``
    (the end of what a race that was stopped by an error wrote, else None) and ``wall`` (of
    race.json, or None). Or ``seed`` and ``refused``, why no such race can be flown here.

    Raises RaceKilled if it was killed from outside.
    """
    files = {TRACK: job.track.encode(), SCENARIO: job.scenario.encode()}
    files |= {f"{DRONE}/{name}": content for name, content in job.drone.items()}
    try:
        check_versions(job.versions, versions(job.systems))
        # Systems of somebody's own may read files beside them.
        place = own_systems_folder() if job.systems else "/"
        flown = ended_race("airrace.evaluation.race_process", files, evaluation, (0, 1), place)
        with flown as race:
            if race.error:
                race.result.update(finished=False, dnf_reason=race.error)
            return {
                "seed": job.seed,
                "gates": job.gates,
                "length_m": job.length,
                "result": race.result,
                "stderr": race.stderr,
                "wall": race.wall,
            }
    except RaceRefused as e:
        return {"seed": job.seed, "refused": str(e)}


def check_versions(expected: dict, actual: dict) -> None:
    """Raises RaceRefused unless a race is flown by what it is to be flown with."""
    if differs := mismatch(expected, actual):
        raise RaceRefused(
            f"a worker has {differs}; change no files while races are flown, and give all workers "
            "the same."
        )


@contextlib.contextmanager
def ended_race(
    module: str,
    files: Mapping[str, bytes],
    evaluation: str,
    ends: Collection[int],
    place: str = "/",
) -> Iterator[EndedRace]:
    """Flies a race in a process of its own, and yields how it ended; its folder is then removed.

    Args: module, evaluation, place: see run_process(). files: of the race's folder: path to
    contents. ends: exit codes of a race that was not stopped by an error.

    Raises:
        RaceRefused: if the process says so, by exit code 2.
        RaceKilled: if it was killed from outside.
    """
    with tempfile.TemporaryDirectory(prefix="airrace-", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        for file, content in files.items():
            path = folder / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        code = run_process(module, folder, evaluation, place)
        stderr = (folder / "stderr").read_text("utf-8", errors="replace").strip()
        if code == 2:
            raise RaceRefused(stderr.removeprefix("airrace: ") or "no reason given")
        result = read_json(folder / RESULTS / "race.json") or dict(NO_RESULT)
        wall, reason = result.pop("wall", None), result["dnf_reason"]
        killed_by = signal_name(-code) if code < 0 else None
        if reason == "interrupted" or killed_by in _KILLS:
            raise RaceKilled(f"its process was killed ({killed_by or 'SIGTERM'})")
        error = None
        if killed_by:
            error = f"crashed ({killed_by})"
        elif (reason or "").startswith(STOPPED):  # by code of somebody's own, which it names
            error = reason
        elif code not in ends or (reason in _NO_REASONS and not result["finished"]):
            # Python says in the last line what the error was.
            last_line = printable((stderr.splitlines() or ["nothing was said"])[-1].strip())
            error = f"{STOPPED}{last_line}"
        yield EndedRace(folder, result, wall, error, stderr[-_TAIL:] if error else None)


def read_json(path: Path) -> dict | None:
    """Returns what a file of JSON holds, or None if there is none."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def stop_races(evaluation: str) -> None:
    """Ends the races of an evaluation on this worker, and begins no more of them."""
    with _lock:
        _stopped.add(evaluation)
        for process in _running[evaluation]:
            process.kill()


def run_process(module: str, folder: Path, evaluation: str, place: str = "/") -> int:
    """Runs a module with the folder of a race; returns its exit code.

    What it writes to standard error is left in `stderr` there. Args: evaluation: for stop_races().
    place: its working folder.

    Raises RaceKilled if the evaluation was stopped before.
    """
    with open(folder / "stderr", "wb") as stderr:
        with _lock:
            if evaluation in _stopped:
                raise RaceKilled("the evaluation was stopped")
            process = subprocess.Popen(
                module_command(module, str(folder)),
                cwd=place,
                # Its end tells the process that this one has died.
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=stderr,
                env={**os.environ, **ONE_THREAD},
                start_new_session=True,  # Ctrl-C in the terminal is for the evaluation
            )
            _running[evaluation].add(process)
        try:
            return process.wait()
        finally:
            process.kill()
            process.communicate()
            with _lock:
                _running[evaluation].discard(process)
