"""The process of one race of a league: python -m airrace.league.entry_race FOLDER.

The simulation and the referee are in this process, the autonomy is an entry in a sandbox. When
its standard input ends, whoever waits for the race has died: it removes FOLDER and ends at once.
"""

import contextlib
import dataclasses as dc
import socket
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from airrace.common.errors import exit_code
from airrace.common.files import write_json, write_text
from airrace.common.resources import load_yaml
from airrace.evaluation.race_process import bound_to_worker
from airrace.league.sandbox import EntryProcess, SandboxConfig
from airrace.league.scenarios import SCENARIO, TRACK

if TYPE_CHECKING:
    from airrace.league.entry_remote import EntryRemote
    from airrace.scenario import Scenario

# In the folder of a race: how the entry is held, the results, how it behaved, what it wrote.
SANDBOX, RESULTS, CONDUCT, LOG = "sandbox.yaml", "results", "conduct.json", "entry.log"
REPLAY = "race.html"


def main(folder: Path) -> int:
    """Flies the race; returns the exit code: 0 if it has ended, however; 2 on bad input."""
    with bound_to_worker(folder):
        return exit_code(lambda: _fly(folder))


def _fly(folder: Path) -> int:
    from airrace.diagrams.race import run_race
    from airrace.diagrams.warm_up import compile_apart
    from airrace.league.entry_remote import EntryFailed
    from airrace.scenario import load_scenario

    sandbox = load_yaml(SandboxConfig, filename=folder / SANDBOX)
    scenario = load_scenario(filename=str(folder / SCENARIO))
    scenario.track = str(folder / TRACK)
    # Not with the entry's systems: its code stays in the sandbox.
    compile_apart(dc.replace(scenario, systems={}, policy="none"))
    results = folder / RESULTS
    results.mkdir()
    with _entry_remote(folder, scenario, sandbox) as remote:
        if remote is None:
            return 0
        try:
            run_race(scenario, results, transport=remote)
        except EntryFailed as e:
            _save_failure(folder, str(e))
            return 0
    if sandbox.replay:
        from airrace.analysis.run import load_run
        from airrace.visualization.ghosts import make_ghosts, replay_page

        page = replay_page(make_ghosts([load_run(results)]), pictures=False)
        write_text(results / REPLAY, page)
    return 0


@contextlib.contextmanager
def _entry_remote(
    folder: Path, scenario: "Scenario", sandbox: SandboxConfig
) -> "Iterator[EntryRemote | None]":
    """Starts the entry, and yields the Remote to race with, or None if it cannot race.

    When the block is left, it writes how the entry behaved.
    """
    from airrace.league.entry_remote import EntryFailed, GuardedBus, meet_entry

    ours, theirs = socket.socketpair()
    process = EntryProcess(folder, theirs, sandbox)
    bus, remote = GuardedBus(ours), None
    try:
        try:
            remote = meet_entry(scenario, bus, process, sandbox.limits)
        except EntryFailed as e:
            _save_failure(folder, str(e))
        yield remote
    finally:
        bus.close()
        process.close()
        conduct = dc.asdict(remote.conduct) if remote else {}
        process.log.save(folder / LOG)
        write_json(folder / CONDUCT, {**conduct, "attempts": process.log.attempts})


def _save_failure(folder: Path, reason: str) -> None:
    """Writes race.json of a race that the entry has not begun."""
    from airrace.evaluation.worker import NO_RESULT

    write_json(folder / RESULTS / "race.json", {**NO_RESULT, "dnf_reason": reason, "wall": None})


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
