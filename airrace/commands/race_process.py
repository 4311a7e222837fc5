"""The process of one race: python -m airrace.commands.race_process FOLDER.

It flies the race of the files in FOLDER by `airrace race`,
and ends with it. When its standard input ends, whoever
waits for the race has died: it removes FOLDER and ends at once.
"""

import os
import shutil
import sys
import threading
from pathlib import Path

from airrace.evaluation.worker import DRONE, RESULTS, SCENARIO, TRACK

# Who takes it ends the process: the race, or who removes its folder.
_end = threading.Lock()


def main(folder: Path) -> int:
    """Flies the race; returns the exit code of `airrace race`."""
    threading.Thread(target=_die_with_the_worker, args=(folder,), daemon=True).start()
    from airrace.commands.app import main as airrace

    options: list[str | Path] = ["--scenario_file", folder / SCENARIO, "--track", folder / TRACK]
    if (folder / DRONE).exists():
        options += ["-d", folder / DRONE]
    options += ["--output", folder / RESULTS, "--no-meshcat", "--no-report"]
    try:
        return airrace(["race", *options])
    finally:
        # A race whose folder is being removed fails in the middle of a file.
        # To end here would leave the rest of the folder behind.
        _end.acquire()


def _die_with_the_worker(folder: Path) -> None:
    # Not through sys.stdin: its lock would be held when Python shuts down.
    while os.read(0, 1):
        pass
    _end.acquire()
    # Again and again: the race still writes into the folder.
    for _ in range(100):
        shutil.rmtree(folder, ignore_errors=True)
        if not folder.exists():
            break
    os._exit(1)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
