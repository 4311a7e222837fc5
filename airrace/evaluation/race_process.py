"""The process of one race: python -m airrace.evaluation.race_process FOLDER.

It flies the race of the files in FOLDER as `airrace race` does,
and ends with it. When its standard input ends, whoever
waits for the race has died: it removes FOLDER and ends at once.
"""

import sys
from pathlib import Path

from airrace.common.errors import exit_code
from airrace.evaluation.lifeline import bound_to_worker
from airrace.evaluation.worker import DRONE, RESULTS, SCENARIO, TRACK


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
