"""How an evaluation's time falls with its workers, and whether its results change.

    python -m benchmarks.evaluation [--races 20] [--time_limit 20] [--workers 1 2] [--json FILE]

The same races are flown once for every number of workers, each time by the
command line of `airrace evaluate`, of whose wall time all is counted.
Two workers on two cores are meant to take at most 0.6 of the time of one.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks import harness

_BOUND = 0.6  # of the time of one worker, for two


def main(argv=None) -> int:
    """Flies everything and prints the table; exit code 1 if results differ or the bound breaks."""
    parser = harness.make_parser(__doc__)
    parser.add_argument(
        "--races", type=harness.count, default=20, help="of an evaluation (default: 20)"
    )
    parser.add_argument(
        "--time_limit", type=float, default=20.0, help="of a race (s, simulated; default: 20)"
    )
    parser.add_argument(
        "--workers",
        type=harness.count,
        nargs="+",
        default=[1, 2],
        help="numbers to compare, the first with the others (default: 1 2)",
    )
    return harness.run(parser, argv, measure, show)


def measure(args) -> list:
    """Returns a row for every number of workers."""
    with tempfile.TemporaryDirectory() as name:
        runs = [fly(Path(name) / f"{i}", n, args) for i, n in enumerate(args.workers)]
    return [
        {
            "workers": workers,
            "seconds": seconds,
            "ratio": seconds / runs[0][0],
            "identical": results == runs[0][1],
        }
        for workers, (seconds, results) in zip(args.workers, runs)
    ]


def fly(folder: Path, workers: int, args) -> tuple:
    """Returns the wall time (s), and the results."""
    options = {
        "tracks": args.races,
        "laps": 1,
        "scenario_file": "races",
        "scenario_text": f"referee: {{time_limit: {args.time_limit}}}",
        "workers": workers,
        "output": folder,
    }
    command = [sys.executable, "-m", "airrace", "evaluate"]
    command += [f"--{name}={value}" for name, value in options.items()]
    start = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    seconds = time.perf_counter() - start
    rows = (folder / "races.jsonl").read_text().splitlines()
    reports = [(folder / f"evaluation.{end}").read_bytes() for end in ("json", "md", "png")]
    return seconds, (reports, sorted(map(_without_wall_times, rows)))


def _without_wall_times(line: str) -> str:
    row = json.loads(line)
    del row["wall"]
    return json.dumps(row)


def show(runs: list) -> tuple[list, bool]:
    """Returns the table of the runs, and whether results are equal and the bound is kept."""
    columns = {
        "workers": "{workers}",
        "wall time (s)": "{seconds:.1f}",
        "of the first": "{ratio:.2f}",
        "same results": "{identical}",
    }
    title = f"The same races; two workers: at most {_BOUND} of the time of one"
    fast = all(run["ratio"] <= _BOUND for run in runs[1:] if run["workers"] == 2)
    passed = fast and all(run["identical"] for run in runs)
    return [harness.make_table(title, runs, columns)], passed


if __name__ == "__main__":
    sys.exit(main())
