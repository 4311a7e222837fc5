"""How much memory a long race takes, and whether it grows.

    python -m benchmarks.endurance [--runs 5] [--laps 100] [-t 3] [--json FILE]

A process flies a race from pixels; its resident memory is read at the end of every
lap. Growth is the slope of a line through all but the first ten laps. Every run is a
process of its own.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path

import numpy as np
import psutil
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from airrace.diagrams.runner import run_race
from airrace.diagrams.warm_up import compile_apart
from airrace.scenario import TRAJECTORIES, Scenario
from benchmarks.fresh import in_fresh_processes

_SETTLED = 10  # laps, after which every buffer has its size
LIMITS = 700.0, 1.0  # MB, MB a lap


def main(argv=None) -> int:
    """Flies the races and prints the table; exit code 1 if one did not finish."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--runs", type=int, default=5, help="races, each of some minutes (default: 5)"
    )
    parser.add_argument("--laps", type=int, default=100, help="(default: 100)")
    parser.add_argument(
        "-t", "--trajectory", choices=TRAJECTORIES, default="3", help="(default: 3)"
    )
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    args = parser.parse_args(argv)
    if args.runs < 1:
        parser.error("--runs must be at least 1")
    if args.laps <= _SETTLED + 1:
        parser.error(f"--laps must be more than {_SETTLED + 1}, to tell growth from the start")
    compile_apart(make_scenario(args.trajectory, args.laps))
    labels = [f"Race {k} of {args.runs}" for k in range(1, args.runs + 1)]
    rows = list(in_fresh_processes(fly, [(args.trajectory, args.laps, label) for label in labels]))
    Console(width=120).print(make_table(rows))
    if args.json is not None:
        args.json.write_text(json.dumps(rows, indent=1))
    return 0 if all(row["finished"] for row in rows) else 1


def make_scenario(trajectory: str, laps: int) -> Scenario:
    """Returns the default scenario with some laps of a kind."""
    return Scenario(trajectory=trajectory, laps=laps)


def fly(trajectory: str, laps: int, label: str) -> dict:
    """Flies a race, with a bar of that label.

    Returns:
        ``finished``, ``memory_mb`` at the end of each lap, and their summary().
    """
    process, memory = psutil.Process(), []
    with tempfile.TemporaryDirectory() as folder, Progress(console=Console(stderr=True)) as bar:
        task = bar.add_task(label, total=laps)

        def show(record, look):
            for _ in range(look.laps_ended):
                memory.append(process.memory_info().rss / 2**20)
                bar.advance(task)

        race = run_race(make_scenario(trajectory, laps), Path(folder), show=show)
    return {"finished": race["finished"], "memory_mb": memory, **summary(memory)}


def summary(memory) -> dict:
    """Returns the greatest memory (MB) and its growth (MB a lap) of one number a lap (MB)."""
    laps = np.arange(len(memory))
    settled = laps >= _SETTLED
    growth = np.polyfit(laps[settled], np.array(memory)[settled], 1)[0] if sum(settled) > 1 else 0
    return {"most_mb": float(max(memory, default=0.0)), "growth_mb_a_lap": float(growth)}


def make_table(rows) -> Table:
    """Returns the table of what fly() returns."""
    table = Table(title="Memory of a race")
    for name in ("", "laps", "after the first (MB)", "most (MB)", "growth (MB a lap)"):
        table.add_column(name, justify="right")
    numbers = np.array(
        [
            [
                row["memory_mb"][0] if row["memory_mb"] else np.nan,
                row["most_mb"],
                row["growth_mb_a_lap"],
            ]
            for row in rows
        ]
    )

    def cells(first, most, growth):
        return f"{first:.0f}", f"{most:.0f}", f"{growth:.3f}"

    for k, row in enumerate(rows):
        table.add_row(f"race {k + 1}", str(len(row["memory_mb"])), *cells(*numbers[k]))
    table.add_section()
    table.add_row("median", "", *cells(*np.median(numbers, axis=0)))
    table.add_row("to be below", "", "", *(f"{limit:g}" for limit in LIMITS))
    return table


if __name__ == "__main__":
    sys.exit(main())
