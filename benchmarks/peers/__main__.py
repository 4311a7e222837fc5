"""How fast one drone flies without a camera, here and in other simulators.

    python -m benchmarks.peers [--install] [--runs 5] [--json FILE]

Every simulator flies its own drone under its own controller on the same circle, in a
process of its own on one core, one after the other, run by run. Start-up, compiling and
the first laps do not count. --install puts the peers into environments of their own,
from the package index that pip is configured for (about 7 GB). gym-pybullet-drones is not
among them: it is installed from a clone of its repository, not from a package index.
"""

import sys
from pathlib import Path

import numpy as np

from benchmarks import harness
from benchmarks.peers import circle
from benchmarks.peers import environments as env

_OURS = "airrace"


def main(argv=None) -> int:
    """Flies all and prints the table; exit code 1 if one did not fly."""
    parser = harness.make_parser(__doc__, runs=5)
    parser.prog = "python -m benchmarks.peers"
    parser.add_argument("--install", action="store_true", help="install the peers if need be")
    env.add_folder(parser)
    return harness.run(parser, argv, measure, show)


def measure(args) -> dict:
    """Flies every simulator in turn, so that other work of the machine slows down all of them.

    Returns:
        ``flights``: name to the list of what circle.report() printed in each run, of the
        simulators that flew in every run; ``failures``: name to a clause on why, of the
        others; ``rows``: the medians, with ``ours``, see compare().
    """
    folder = args.folder.absolute()
    pythons, flights, failures = {_OURS: Path(sys.executable)}, {}, {}
    for name, requirement in env.requirements().items():
        try:
            if args.install:
                env.install(folder, name, requirement)
            pythons[name] = env.python_of(folder, name, requirement)
        except env.PeerError as e:
            failures[name] = str(e)
    for name in harness.progress(args.runs * list(pythons), "Flying"):
        if name not in failures:
            try:
                flights.setdefault(name, []).append(env.fly(pythons[name], f"fly_{name}"))
            except env.PeerError as e:
                failures[name] = str(e)
    flights = {name: runs for name, runs in flights.items() if name not in failures}
    rows = [row for runs in flights.values() for row in medians(runs)]
    compare(rows)
    return {"rows": rows, "failures": failures, "flights": flights}


def medians(runs: list) -> list[dict]:
    """Returns the rows of a simulator, of what circle.report() printed in each run.

    Times become ``x_wall`` and ``x_cpu``, simulated seconds for each second of those;
    ``x_cpu_range`` is its least and greatest.
    """
    rows = []
    for same in zip(*(run["rows"] for run in runs)):
        wall, cpu = (
            harness.column(same, "simulated_s") / harness.column(same, key)
            for key in ("wall_s", "cpu_s")
        )
        row = {"simulator": runs[0]["simulator"]} | same[0]
        del row["wall_s"], row["cpu_s"]
        row |= {"x_wall": float(np.median(wall)), "x_cpu": float(np.median(cpu))}
        row |= {"x_cpu_range": [float(cpu.min()), float(cpu.max())]}
        row["rms_m"] = float(np.median(harness.column(same, "rms_m")))
        rows.append(row)
    return rows


def compare(rows: list) -> None:
    """Adds ``ours``: how many times as fast airrace is, by CPU time, at the same rate.

    The rate is that of the attitude loop. None for airrace, and where it has not flown
    at that rate.
    """
    ours = {r["attitude_hz"]: r["x_cpu"] for r in rows if r["simulator"].startswith(_OURS)}
    for row in rows:
        compared = row["attitude_hz"] in ours and not row["simulator"].startswith(_OURS)
        row["ours"] = ours[row["attitude_hz"]] / row["x_cpu"] if compared else None


def show(results: dict) -> tuple[list, bool]:
    """Returns the table and a line for each failure, and whether all flew."""
    columns = {
        "simulator": "{simulator}",
        "with": "{controller}, {integrator}; {besides}",
        "position, attitude,\nphysics (Hz)": "{position_hz}, {attitude_hz}, {physics_hz}",
        "error,\nRMS (m)": "{rms_m:.3f}",
        "speed,\nwall": "{x_wall:.1f}",
        "speed,\nCPU": "{x_cpu:.1f}",
        "airrace,\nsame rate": lambda row: f"{row['ours']:.2g} times" if row["ours"] else "-",
    }
    title = (
        f"One drone on a circle of {circle.RADIUS:g} m, {circle.PERIOD:g} s a lap, "
        "no camera, one core; speeds as multiples of real time"
    )
    failures = [f"{name}: {reason}." for name, reason in results["failures"].items()]
    return [harness.make_table(title, results["rows"], columns), *failures], not failures


if __name__ == "__main__":
    sys.exit(main())
