"""The process of one race: python -m airrace.evaluation.race_process FOLDER.

It flies the race of the files in FOLDER as `airrace race` does, and ends with it, or with the
worker that waits for the race.
"""

import contextlib
import os
import shutil
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

from airrace.common.errors import exit_code
from airrace.evaluation.worker import DRONE, RESULTS, SCENARIO, TRACK

# Who takes it ends the process: the race, or who removes its folder.
_end = threading.Lock()


@contextlib.contextmanager
def bound_to_worker(folder: Path) -> Iterator[None]:
    """Ends this process, and removes a folder, when its standard input ends.

    That is when whoever waits for the race has died. Nothing runs in this process after the block.
    """
    threading.Thread(target=_die_with_the_worker, args=(folder,), daemon=True).start()
    try:
        yield
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


def main(folder: Path) -> int:
    """Flies the race; returns the exit code of `airrace race`."""
    with bound_to_worker(folder):
        from airrace.diagrams.race_command import RaceOptions, race

        drone = folder / DRONE
        options = RaceOptions(
            scenario_file=str(folder / SCENARIO),
            track=str(folder / TRACK),
            drone=str(drone) if drone.exists() else None,
            output=folder / RESULTS,
            meshcat=False,
            report=False,
        )
        return exit_code(lambda: race(options=options))


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
