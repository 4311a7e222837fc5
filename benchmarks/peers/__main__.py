"""How fast one drone flies without a camera, here and in other simulators.

    python -m benchmarks.peers [--install] [--runs 5] [--json FILE]

Every simulator flies its own drone under its own controller on the same circle, in a
process of its own on one core, one after the other, run by run. Start-up, compiling and
the first laps do not count. --install puts the peers into environments of their own,
from the package index that pip is configured for (about 2 GB).
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from benchmarks.peers import circle
from benchmarks.peers import environments as env

OURS = "airrace"
_NOTE = (
    "gym-pybullet-drones is not among the peers: it is installed from a clone of its "
    "repository, not from a package index."
)


def main(argv=None) -> int:
    """Flies all and prints the table; exit code 1 if one did not fly."""
    parser = argparse.ArgumentParser(
        description=__doc__.splitlines()[0], epilog=" ".join(__doc__.split("\n\n")[2].split())
    )
    parser.add_argument("--install", action="store_true", help="install the peers if need be")
    parser.add_argument(
        "--folder",
        type=Path,
        default=env.default_folder(),
        help="of the peers' environments (default: %(default)s)",
    )
    parser.add_argument("--runs", type=int, default=5, help="of each simulator (default: 5)")
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    args = parser.parse_args(argv)
    if args.runs < 1:
        parser.error("--runs must be at least 1")
    flights, failures = measure(args.folder.absolute(), args.runs, install=args.install)
    rows = [row for results in flights.values() for row in medians(results)]
    compare(rows)
    console = Console(width=120)
    console.print(make_table(rows))
    if OURS in flights:
        console.print(shares_sentence(flights[OURS]))
    for name, reason in failures.items():
        console.print(f"{name}: {reason}.", soft_wrap=True)
    console.print(_NOTE, soft_wrap=True)
    if args.json is not None:
        args.json.write_text(
            json.dumps({"rows": rows, "failures": failures, "flights": flights}, indent=1)
        )
    return 1 if failures else 0


def measure(folder: Path, runs: int, *, install: bool) -> tuple[dict, dict]:
    """Flies every simulator in turn, so that all see the same of the machine's moods.

    Args:
        folder: of the peers' environments.
        runs: of each simulator.
        install: whether to make environments that are not there.

    Returns:
        name to the list of what circle.report() printed in each run, of those that flew
        in every run; and name to a clause on why, of the others.
    """
    pythons, flights, failures = {OURS: sys.executable}, {}, {}
    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None)
        for name, requirement in env.requirements().items():
            try:
                if install:
                    bar.update(task, description=f"Installing {name}")
                    env.install(folder, name, requirement)
                pythons[name] = env.python_of(folder, name, requirement)
            except env.PeerError as e:
                failures[name] = str(e)
        bar.update(task, description="Flying", total=runs * len(pythons))
        for _ in range(runs):
            for name, python in pythons.items():
                if name not in failures:
                    try:
                        flights.setdefault(name, []).append(env.fly(python, f"fly_{name}"))
                    except env.PeerError as e:
                        failures[name] = str(e)
                bar.advance(task)
    return {n: results for n, results in flights.items() if n not in failures}, failures


def medians(results) -> list[dict]:
    """Returns the rows of a simulator, of what circle.report() printed in each run.

    Times become ``x_wall`` and ``x_cpu``, simulated seconds for each second of those;
    ``x_cpu_range`` is its least and greatest.
    """
    rows = []
    for runs in zip(*(result["rows"] for result in results)):
        row = {"simulator": results[0]["simulator"]} | runs[0]
        rates = {
            key: [run["simulated_s"] / run.pop(f"{key}_s") for run in map(dict, runs)]
            for key in ("wall", "cpu")
        }
        for key in ("wall", "cpu"):
            del row[f"{key}_s"]
            row[f"x_{key}"] = float(np.median(rates[key]))
        row["x_cpu_range"] = [min(rates["cpu"]), max(rates["cpu"])]
        row["rms_m"] = float(np.median([run["rms_m"] for run in runs]))
        rows.append(row)
    return rows


def compare(rows) -> None:
    """Adds ``ours``: how many times as fast airrace is, by CPU time, at the same rate.

    The rate is that of the attitude loop. None for airrace, and where it has not flown
    at that rate.
    """
    ours = {row["attitude_hz"]: row["x_cpu"] for row in rows if _is_ours(row)}
    for row in rows:
        rate = row["attitude_hz"]
        compared = rate in ours and not _is_ours(row)
        row["ours"] = ours[rate] / row["x_cpu"] if compared else None


def _is_ours(row) -> bool:
    return row["simulator"].startswith(OURS)


def make_table(rows) -> Table:
    """Returns the table of the rows of medians(), after compare()."""
    table = Table(
        title=f"One drone on a circle of {circle.RADIUS:g} m, {circle.PERIOD:g} s a lap, "
        "no camera, one core; speeds as multiples of real time"
    )
    table.add_column("simulator", no_wrap=True)
    table.add_column("with")
    for name in (
        "position, attitude,\nphysics (Hz)",
        "error,\nRMS (cm)",
        "speed,\nwall",
        "speed,\nCPU",
        "airrace,\nsame rate",
    ):
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(
            row["simulator"],
            f"{row['controller']}, {row['integrator']}; {row['besides']}",
            f"{row['position_hz']}, {row['attitude_hz']}, {row['physics_hz']}",
            f"{100 * row['rms_m']:.1f}",
            f"{row['x_wall']:.1f}",
            f"{row['x_cpu']:.1f}",
            "-" if row["ours"] is None else f"{row['ours']:.2g} times",
        )
    return table


def shares_sentence(results) -> str:
    """Returns a sentence on what takes our time, from what our report() printed."""
    names = results[0]["shares"]
    shares = {name: np.median([result["shares"][name] for result in results]) for name in names}
    parts = ", ".join(
        f"{name} {share:.0%}"
        for name, share in sorted(shares.items(), key=lambda item: -item[1])
        if share >= 0.005
    )
    return f"airrace's CPU time at {results[0]['rows'][-1]['attitude_hz']} Hz: {parts}."


if __name__ == "__main__":
    sys.exit(main())
