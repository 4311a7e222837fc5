"""How much memory a long race takes, and whether it grows.

    python -m benchmarks.endurance [--laps 100] [-t 3] [--json FILE]

One process flies a race from pixels; its resident memory is read at the end of every
lap. Growth is the slope of a line through all but the first ten laps.
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
from airrace.diagrams.scenario import TRAJECTORIES, Scenario
from airrace.diagrams.warm_up import compile_apart

_SETTLED = 10  # laps, after which every buffer has its size


def main(argv=None) -> int:
    """Flies the race and prints the table; exit code 1 if it did not finish."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--laps", type=int, default=100, help="(default: 100)")
    parser.add_argument("-t", "--trajectory", choices=TRAJECTORIES, default="3",
                        help="(default: 3)")
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    args = parser.parse_args(argv)
    if args.laps <= _SETTLED + 1:
        parser.error(f"--laps must be more than {_SETTLED + 1}, to tell growth from the start")
    scenario = Scenario(trajectory=args.trajectory, laps=args.laps)
    compile_apart(scenario)
    process, memory = psutil.Process(), []
    with tempfile.TemporaryDirectory() as folder, Progress(console=Console(stderr=True)) as bar:
        task = bar.add_task("Racing", total=args.laps)

        def show(record, look):
            for _ in range(look.laps_ended):
                memory.append(process.memory_info().rss / 2**20)
                bar.advance(task)

        race = run_race(scenario, Path(folder), show=show)
    result = {"finished": race["finished"], "memory_mb": memory, **summary(memory)}
    Console(width=120).print(make_table(result))
    if args.json is not None:
        args.json.write_text(json.dumps(result, indent=1))
    return 0 if race["finished"] else 1


def summary(memory) -> dict:
    """Returns the greatest memory (MB) and its growth (MB a lap) of one number a lap (MB)."""
    laps = np.arange(len(memory))
    settled = laps >= _SETTLED
    growth = np.polyfit(laps[settled], np.array(memory)[settled], 1)[0] if sum(settled) > 1 else 0
    return {"most_mb": float(max(memory, default=0.0)), "growth_mb_a_lap": float(growth)}


def make_table(result) -> Table:
    """Returns the table of a result of main()."""
    table = Table(title="Memory of a race")
    for name in ("laps", "after the first (MB)", "most (MB)", "growth (MB a lap)"):
        table.add_column(name, justify="right")
    memory = result["memory_mb"]
    table.add_row(
        str(len(memory)), f"{memory[0]:.0f}" if memory else "-", f"{result['most_mb']:.0f}",
        f"{result['growth_mb_a_lap']:.3f}",
    )
    return table


if __name__ == "__main__":
    sys.exit(main())
