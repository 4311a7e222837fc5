"""How long one waits for the first simulated second, and for the help.

    python -m benchmarks.start_up [--runs 5] [--json FILE]

Both are run as anybody would, by ./run.bash on a set-up that is ready, and without
the live view and the report. The race ends after a second on the pad, so what it
writes at its end counts, too. A first run, which is not counted, compiles what is
yet to be.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

_ROOT = Path(__file__).parent.parent
COMMANDS = {
    "./run.bash --help": ["--help"],
    "./run.bash, to the first simulated second": [
        "--no-meshcat",
        "--no-report",
        "--laps",
        "1",
        "--scenario_text",
        "{referee: {time_limit: 1.0}}",
    ],
}
LIMITS = {"./run.bash --help": 1.5, "./run.bash, to the first simulated second": 3.0}  # s


def main(argv=None) -> int:
    """Runs the commands and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=5, help="of each command (default: 5)")
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    args = parser.parse_args(argv)
    jobs = [name for name in COMMANDS for _ in range(args.runs + 1)]
    times = {name: [] for name in COMMANDS}
    for name in track(jobs, "Starting", console=Console(stderr=True)):
        times[name].append(duration(COMMANDS[name]))
    rows = [{"command": name, "seconds": seconds[1:]} for name, seconds in times.items()]
    Console(width=120).print(make_table(rows))
    if args.json is not None:
        args.json.write_text(json.dumps(rows, indent=1))
    return 0


def duration(options) -> float:
    """Returns how long ./run.bash takes with some options (s)."""
    with tempfile.TemporaryDirectory() as folder:
        if "--help" not in options:
            options = [*options, "--output", f"{folder}/race"]
        clock = time.perf_counter()
        done = subprocess.run(
            ["bash", str(_ROOT / "run.bash"), *options],
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
        )
        taken = time.perf_counter() - clock
    if done.returncode not in (0, 1):  # a race that runs out of time is not finished
        raise RuntimeError(f"run.bash ended with exit code {done.returncode}: {done.stderr}")
    return taken


def make_table(rows) -> Table:
    """Returns the table of the rows that main() collects."""
    table = Table(title="Start-up")
    for name in ("command", "median (s)", "least (s)", "most (s)", "to be below (s)"):
        table.add_column(name, justify="left" if name == "command" else "right")
    for row in rows:
        seconds = row["seconds"]
        table.add_row(
            row["command"],
            f"{np.median(seconds):.2f}",
            f"{min(seconds):.2f}",
            f"{max(seconds):.2f}",
            f"{LIMITS[row['command']]:.1f}",
        )
    return table


if __name__ == "__main__":
    sys.exit(main())
