"""How an evaluation's time falls with its workers, and whether its results change.

    python -m benchmarks.evaluation [--races 20] [--time_limit 20] [--workers 1 2] [--json FILE]

The same races are flown once for every number of workers, each time by the
command line of airrace.diagrams.evaluate, of whose wall time all is counted.
Two workers on two cores are meant to take at most 0.6 of the time of one.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

BOUND = 0.6  # of the time of one worker, for two


def main(argv=None) -> int:
    """Flies everything and prints the table; exit code 1 if results differ or the bound breaks."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--races", type=int, default=20, help="of an evaluation (default: 20)")
    parser.add_argument(
        "--time_limit", type=float, default=20.0, help="of a race (s, simulated; default: 20)"
    )
    parser.add_argument(
        "--workers",
        type=int,
        nargs="+",
        default=[1, 2],
        help="numbers to compare, the first with the others (default: 1 2)",
    )
    parser.add_argument("--json", type=Path, help="also write what the table shows")
    args = parser.parse_args(argv)
    with tempfile.TemporaryDirectory() as name:
        runs = [fly(Path(name) / f"{i}-{n}", n, args) for i, n in enumerate(args.workers)]
    table = [
        {
            "workers": workers,
            "seconds": seconds,
            "ratio": seconds / runs[0][1],
            "identical": results == runs[0][2],
        }
        for workers, seconds, results in runs
    ]
    Console().print(make_table(table, args.races))
    if args.json is not None:
        args.json.write_text(json.dumps(table, indent=1))
    keeps = all(run["ratio"] <= BOUND for run in table[1:] if run["workers"] == 2)
    return 0 if keeps and all(run["identical"] for run in table) else 1


def fly(folder: Path, workers: int, args) -> tuple:
    """Returns the number of workers, the wall time (s), and the results."""
    start = time.perf_counter()
    subprocess.run(
        [
            sys.executable,
            "-m",
            "airrace.diagrams.evaluate",
            "--tracks",
            str(args.races),
            "--laps",
            "1",
            "--scenario_file",
            "races",
            "--scenario_text",
            f"referee: {{time_limit: {args.time_limit}}}",
            "--workers",
            str(workers),
            "--output",
            str(folder),
        ],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    seconds = time.perf_counter() - start
    rows = (folder / "races.jsonl").read_text().splitlines()
    reports = [(folder / f"evaluation.{end}").read_bytes() for end in ("json", "md", "png")]
    return workers, seconds, (reports, sorted(map(without_wall_times, rows)))


def without_wall_times(line: str) -> str:
    """Returns a line of races.jsonl without what depends on the machine's speed."""
    row = json.loads(line)
    del row["wall"]
    return json.dumps(row)


def make_table(runs: list, races: int) -> Table:
    """Returns the table of the runs."""
    table = Table(title=f"{races} races; two workers: at most {BOUND} of the time of one")
    for name in ("workers", "wall time (s)", "of the first", "same results"):
        table.add_column(name, justify="right")
    for run in runs:
        table.add_row(
            str(run["workers"]),
            f"{run['seconds']:.1f}",
            f"{run['ratio']:.2f}",
            "yes" if run["identical"] else "no",
        )
    return table


if __name__ == "__main__":
    sys.exit(main())
