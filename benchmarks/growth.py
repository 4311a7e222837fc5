"""What a longer track costs: races of 10 and of 20 gates, per simulated second.

    python -m benchmarks.growth [--runs 5] [--laps 1] [--json FILE]

Each run flies a generated track of either length from pixels, one after the other,
so that other work of the machine slows down both.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console
from rich.progress import track as progress
from rich.table import Table

from airrace.evaluation.jobs import generated_track
from airrace.scenario import load_scenario
from benchmarks.timed_race import time_race

GATES = 10, 20
LIMIT = 1.3  # times the cost of the shorter one
_FIRST_SEED = 1000


def main(argv=None) -> int:
    """Flies the races and prints the table; exit code 1 if one did not finish."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=5, help="tracks of either length (default: 5)")
    parser.add_argument("--laps", type=int, default=1, help="after exploring (default: 1)")
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    args = parser.parse_args(argv)
    cv2.setNumThreads(1)
    seeds = range(_FIRST_SEED, _FIRST_SEED + args.runs)
    jobs = [(seed, gates) for seed in seeds for gates in GATES]
    rows = [fly(*job, args.laps) for job in progress(jobs, "Racing", console=Console(stderr=True))]
    Console(width=120).print(make_table(rows))
    if args.json is not None:
        args.json.write_text(json.dumps(rows, indent=1))
    return 0 if all(row["finished"] for row in rows) else 1


def fly(seed: int, gates: int, laps: int) -> dict:
    """Returns what a race on a generated track takes, in wall and CPU seconds."""
    with tempfile.TemporaryDirectory() as folder:
        track = Path(folder, "track.yaml")
        track.write_text(generated_track(seed, gates)[1])
        scenario = load_scenario()
        scenario.track, scenario.laps, scenario.seed = str(track), laps, seed
        scenario.recording.content = "none"
        race, times = time_race(scenario, Path(folder))
    return {"seed": seed, "gates": gates, "finished": race["finished"], **times}


def make_table(rows) -> Table:
    """Returns the table of the rows that main() collects."""
    table = Table(title="Races of either length, medians")
    for name in (
        "gates",
        "finished",
        "simulated (s)",
        "x real time",
        "beside 10 gates",
        "to be at most",
    ):
        table.add_column(name, justify="right")
    races = {gates: [row for row in rows if row["gates"] == gates] for gates in GATES}
    costs = {
        gates: np.array([row["cpu_s"] / row["simulated_s"] for row in own])
        for gates, own in races.items()
    }
    for gates, own in races.items():
        table.add_row(
            str(gates),
            f"{sum(row['finished'] for row in own)} of {len(own)}",
            f"{np.median([row['simulated_s'] for row in own]):.0f}",
            f"{1.0 / np.median(costs[gates]):.2f}",
            f"{np.median(costs[gates] / costs[GATES[0]]):.2f}",
            f"{LIMIT if gates == GATES[1] else 1.0:.1f}",
        )
    return table


if __name__ == "__main__":
    sys.exit(main())
