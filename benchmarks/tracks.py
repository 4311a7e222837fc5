"""Whether the track generator's tracks keep the rules, what they are like, and its speed.

    python -m benchmarks.tracks [--seeds 1000] [--gates N] [--direction left|right] [--json FILE]

Every track is written, read again as a race would, and checked.
"""

import sys
import time

import numpy as np

from airrace.common.errors import UserError
from airrace.common.resources import load_yaml
from airrace.track import Track
from airrace.track.command import to_yaml
from airrace.track.generator import DIRECTIONS, generate_track
from airrace.track.layout import Layout
from airrace.track.rules import check_rules
from benchmarks import harness


def main(argv=None) -> int:
    """Generates and prints the table; exit code 1 if a seed gave no valid track."""
    parser = harness.make_parser(__doc__)
    parser.add_argument(
        "--seeds", type=harness.count, default=1000, help="0 to below this (default: 1000)"
    )
    parser.add_argument("--gates", type=int, help="of every track (default: drawn)")
    parser.add_argument("--direction", choices=DIRECTIONS, help="of every track (default: drawn)")
    return harness.run(parser, argv, measure, show)


def measure(args) -> list:
    """Returns a row for every seed."""
    seeds = harness.progress(range(args.seeds), "Generating")
    return [generate(seed, args.gates, args.direction) for seed in seeds]


def generate(seed: int, gates=None, direction=None) -> dict:
    """Returns the figures of a seed's track; ``fault`` is None or says what is wrong."""
    begin = time.perf_counter()
    try:
        generated = generate_track(seed, gates, direction)
    except UserError as e:
        return {"seed": seed, "fault": str(e)}
    wall = time.perf_counter() - begin
    fault = None
    try:
        track = load_yaml(Track, data=to_yaml(generated, "a track"))
        track.check()
        check_rules(track)
    except (UserError, ValueError) as e:
        fault = str(e)
    layout = Layout.of(generated)
    around = np.linalg.norm(np.roll(layout.middle, -1, axis=0) - layout.middle, axis=1).sum()
    return {
        "seed": seed,
        "fault": fault,
        "gates": len(generated.gates),
        "wall_s": wall,
        "direction": "left" if layout.turns.sum() > 0 else "right",
        "lap_m": float(around),
        "legs_m": layout.lengths.tolist(),
    }


def show(rows: list) -> tuple[list, bool]:
    """Returns a table with a row for each number of gates, a line a fault, and if all is well."""
    made = [row for row in rows if "gates" in row]
    by_gates = sorted(harness.groups(made, "gates"))
    figures = [_figures(str(n), group) for (n,), group in by_gates]
    columns = {
        "gates": "{gates}",
        "tracks": "{tracks}",
        "left": "{left}",
        "valid": "{valid}",
        "lap, min (m)": "{lap[0]:.0f}",
        "median lap": "{lap[1]:.0f}",
        "max lap": "{lap[2]:.0f}",
        "leg, min (m)": "{leg[0]:.1f}",
        "median leg": "{leg[1]:.1f}",
        "max leg": "{leg[2]:.1f}",
        "time, median (ms)": "{ms[1]:.0f}",
        "max": "{ms[2]:.0f}",
    }
    if made:
        figures.append(_figures("all", made))
    faults = [f"seed {row['seed']}: {row['fault']}" for row in rows if row["fault"] is not None]
    return [harness.make_table("Generated tracks", figures, columns), *faults], not faults


def _figures(gates: str, rows: list) -> dict:
    def quantiles(values):
        return np.quantile(values, [0.0, 0.5, 1.0])

    return {
        "gates": gates,
        "tracks": len(rows),
        "left": sum(row["direction"] == "left" for row in rows),
        "valid": sum(row["fault"] is None for row in rows),
        "lap": quantiles(harness.column(rows, "lap_m")),
        "leg": quantiles(np.concatenate([row["legs_m"] for row in rows])),
        "ms": quantiles(1e3 * harness.column(rows, "wall_s")),
    }


if __name__ == "__main__":
    sys.exit(main())
