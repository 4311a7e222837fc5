"""The process of one race: python -m airrace.commands.race_process FOLDER.

It flies the race of the files in FOLDER by `airrace race`,
and ends with it. When its standard input ends, whoever
waits for the race has died: it removes FOLDER and ends at once.
"""

import sys
from pathlib import Path

from airrace.evaluation.lifeline import bound_to_worker
from airrace.evaluation.worker import DRONE, RESULTS, SCENARIO, TRACK


def main(folder: Path) -> int:
    """Flies the race; returns the exit code of `airrace race`."""
    with bound_to_worker(folder):
        from airrace.commands.app import main as airrace

        options: list[str | Path] = ["--scenario_file", folder / SCENARIO]
        options += ["--track", folder / TRACK]
        if (folder / DRONE).exists():
            options += ["-d", folder / DRONE]
        options += ["--output", folder / RESULTS, "--no-meshcat", "--no-report"]
        return airrace(["race", *options])


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
