"""Flies one race on a worker, in a process of its own.

A Drake diagram with Python systems is never freed, and what crashes one race
must not end the others. The process is what somebody who flies that race alone
would start, so that the results are the same.
"""

import collections
import dataclasses as dc
import json
import signal
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

from airrace.common.processes import ONE_THREAD, child_environment
from airrace.evaluation.versions import mismatch, versions

# What is in the folder of one race; evaluation/race_process.py flies it.
SCENARIO, TRACK, DRONE, RESULTS = "scenario.yaml", "track.yaml", "drone", "results"
_KILLS = ("SIGHUP", "SIGINT", "SIGKILL", "SIGTERM")
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
    """One race, with all that a worker on another machine needs to fly it.

    Attributes:
        seed: of the race and, if it was generated, of the track.
        track: YAML of the track.
        gates: number of them.
        length: of the polygon through the gates' midpoints (m).
        scenario: a scenario file; its track is not used.
        drone: contents of the files of the drone's folder by relative names;
            empty for a shipped drone.
        systems: of the scenario.
        versions: see versions(); a worker with others does not fly the race.
    """

    seed: int
    track: str
    gates: int
    length: float
    scenario: str
    drone: dict
    systems: dict
    versions: dict

    @property
    def key(self) -> int:
        """The seed: what tells it from the other races of an evaluation."""
        return self.seed

    def describe(self) -> str:
        """Returns what it is called in a sentence."""
        return f"race with seed {self.seed}"


class RaceKilled(Exception):
    """The race's process was killed from outside; the race is to be flown again."""


def fly(job: RaceJob, evaluation: str) -> dict:
    """Flies a race and returns its row of races.jsonl.

    Args:
        job: the race.
        evaluation: a name for stop_races().

    Returns:
        ``seed``, ``gates``, ``length_m``, ``result`` (race.json without
        ``wall``), ``stderr`` (the end of what a race that was stopped by an
        error wrote, else None) and ``wall`` (of race.json, or None). Or
        ``seed`` and ``refused``, why no such race can be flown here.

    Raises:
        RaceKilled: if it was killed from outside.
    """
    differs = mismatch(job.versions, versions(job.systems))
    if differs:
        return {
            "seed": job.seed,
            "refused": f"a worker has {differs}; change no files while an "
            "evaluation runs, and give all workers the same.",
        }
    with tempfile.TemporaryDirectory(prefix="airrace-", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        (folder / TRACK).write_text(job.track, encoding="utf-8")
        (folder / SCENARIO).write_text(job.scenario, encoding="utf-8")
        for file, content in job.drone.items():
            path = folder / DRONE / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        code = run_process("airrace.evaluation.race_process", folder, evaluation)
        stderr = (folder / "stderr").read_text("utf-8", errors="replace").strip()
        return _row(job, code, stderr, folder / RESULTS / "race.json")


def stop_races(evaluation: str) -> None:
    """Ends the races of an evaluation on this worker, and begins no more of them."""
    with _lock:
        _stopped.add(evaluation)
        for process in _running[evaluation]:
            process.kill()


def run_process(module: str, folder: Path, evaluation: str) -> int:
    """Runs a module as the process of a race; returns its exit code.

    Args:
        module: which is called with the folder.
        folder: of the race; what the process writes to standard error is left in `stderr` there.
        evaluation: a name for stop_races().

    Raises:
        RaceKilled: if the evaluation was stopped before.
    """
    with open(folder / "stderr", "wb") as stderr:
        with _lock:
            if evaluation in _stopped:
                raise RaceKilled("the evaluation was stopped")
            process = subprocess.Popen(
                [sys.executable, "-m", module, str(folder)],
                # Its end tells the process that this one has died.
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=stderr,
                env={**child_environment(), **ONE_THREAD},
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


def _row(job: RaceJob, code: int, stderr: str, race_json: Path) -> dict:
    """Returns the row of a race whose process has ended with an exit code."""
    if code == 2:
        return {"seed": job.seed, "refused": stderr.removeprefix("airrace: ") or "no reason given"}
    try:
        result = json.loads(race_json.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        result = dict(NO_RESULT)
    wall, reason, error = result.pop("wall", None), result["dnf_reason"], None
    signal_name = _signal_name(-code) if code < 0 else None
    if reason == "interrupted" or was_killed(code):
        raise RaceKilled(f"its process was killed ({signal_name or 'SIGTERM'})")
    if signal_name:
        error = f"crashed ({signal_name})"
    elif code > 1 or reason in (None, "stopped by an error", "not over yet"):
        # Python says in the last line what the error was.
        last_line = (stderr.splitlines() or ["nothing was said"])[-1].strip()
        error = None if result["finished"] else f"stopped by an error: {last_line}"
    if error:
        result.update(finished=False, dnf_reason=error)
    return {
        "seed": job.seed,
        "gates": job.gates,
        "length_m": job.length,
        "result": result,
        "stderr": stderr[-_TAIL:] if error else None,
        "wall": wall,
    }


def was_killed(code: int) -> bool:
    """Whether a process with this exit code was killed from outside."""
    return code < 0 and _signal_name(-code) in _KILLS


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
