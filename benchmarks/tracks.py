"""Whether the track generator's tracks keep the rules, what they are like, and its speed.

    python -m benchmarks.tracks [--seeds 1000] [--gates N] [--direction left|right] [--json FILE]

Every track is written, read again as a race would, and checked.
"""

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track as progress
from rich.table import Table

from airrace.common.errors import UserError
from airrace.common.resources import load_yaml
from airrace.track import Track
from airrace.track.__main__ import to_yaml
from airrace.track.generator import DIRECTIONS, generate_track
from airrace.track.layout import Layout
from airrace.track.rules import check_rules


def main(argv=None) -> int:
    """Generates and prints the table; exit code 1 if a seed gave no valid track."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=1000, help="0 to below this (default: 1000)")
    parser.add_argument("--gates", type=int, help="of every track (default: drawn)")
    parser.add_argument("--direction", choices=DIRECTIONS, help="of every track (default: drawn)")
    parser.add_argument("--json", type=Path, help="also write the figures of every seed")
    args = parser.parse_args(argv)
    rows = [
        measure(seed, args.gates, args.direction)
        for seed in progress(range(args.seeds), "Generating", console=Console(stderr=True))
    ]
    console = Console(width=110)
    console.print(make_table(rows))
    for row in rows:
        if row["fault"] is not None:
            console.print(f"seed {row['seed']}: {row['fault']}")
    if args.json is not None:
        args.json.write_text(json.dumps(rows, indent=1))
    return 0 if all(row["fault"] is None for row in rows) else 1


def measure(seed: int, gates=None, direction=None) -> dict:
    """Returns what a seed gives: its track's figures, or in "fault" what is wrong."""
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
        "lap_m": around,
        "legs_m": layout.lengths.tolist(),
    }


def make_table(rows) -> Table:
    """Returns the table of measure(), one row for each number of gates, and all."""
    table = Table(title="Generated tracks")
    for name in (
        "gates",
        "tracks",
        "left",
        "valid",
        "lap, min (m)",
        "mean",
        "max",
        "leg, min (m)",
        "median",
        "max",
        "time, mean (ms)",
        "max",
    ):
        table.add_column(name, justify="right")
    made = [row for row in rows if "gates" in row]
    counts = sorted({row["gates"] for row in made})
    for what, some in [
        *((str(n), [r for r in made if r["gates"] == n]) for n in counts),
        ("all", made),
    ]:
        if not some:
            continue
        laps, walls = ([row[name] for row in some] for name in ("lap_m", "wall_s"))
        legs = np.concatenate([row["legs_m"] for row in some])
        table.add_row(
            what,
            str(len(some)),
            str(sum(row["direction"] == "left" for row in some)),
            str(sum(row["fault"] is None for row in some)),
            *(f"{f(laps):.0f}" for f in (np.min, np.mean, np.max)),
            *(f"{f(legs):.1f}" for f in (np.min, np.median, np.max)),
            *(f"{1000 * f(walls):.0f}" for f in (np.mean, np.max)),
        )
    return table


if __name__ == "__main__":
    sys.exit(main())
