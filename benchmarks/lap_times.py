"""Lap times of whole races against the original system's.

    python -m benchmarks.lap_times [--laps 10] [--seeds 0 1 2] [--json FILE]

Every race is flown from pixels, with exploration, in the default scenario.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from airrace.diagrams.progress import ORIGINAL_MEAN_LAP
from airrace.diagrams.runner import run_race
from airrace.diagrams.scenario import TRAJECTORIES, Scenario


def main(argv=None) -> int:
    """Flies the races and prints the table; exit code 1 if one did not finish."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--laps", type=int, default=10, help="of each race (default: 10)")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0],
                        help="one race each (default: 0)")
    parser.add_argument("--json", type=Path, help="also write all race.json as one list")
    args = parser.parse_args(argv)
    races = [(t, seed) for t in TRAJECTORIES for seed in args.seeds]
    results = []
    for trajectory, seed in track(races, "Racing", console=Console(stderr=True)):
        with tempfile.TemporaryDirectory() as directory:
            scenario = Scenario(trajectory=trajectory, seed=seed, laps=args.laps)
            scenario.recording.content = "none"
            results.append(run_race(scenario, Path(directory)))
    Console(width=120).print(make_table(results))
    if args.json is not None:
        args.json.write_text(json.dumps(results, indent=1))
    return 0 if all(r["finished"] for r in results) else 1


def make_table(results) -> Table:
    """Returns the table of a list of race.json, one row a trajectory."""
    table = Table(title="Laps of the reference track")
    for name in ("trajectory", "finished", "mean lap (s)", "best lap (s)", "original (s)",
                 "exploration (s)", "worst gate offset (m)", "map RMS (cm)", "x real time"):
        table.add_column(name, justify="right")
    for trajectory in TRAJECTORIES:
        races = [r for r in results if r["trajectory"] == trajectory]
        laps = [lap for r in races for lap in r["laps"]]
        if not laps:
            continue
        table.add_row(
            f"{trajectory}-D" if trajectory.isdigit() else trajectory,
            f"{sum(r['finished'] for r in races)}/{len(races)}",
            f"{np.mean([lap['time_s'] for lap in laps]):.2f}",
            f"{min(lap['time_s'] for lap in laps):.2f}",
            f"{ORIGINAL_MEAN_LAP[trajectory]:.2f}",
            f"{np.mean([r['exploration']['time_s'] for r in races]):.1f}",
            f"{max(max(lap['gate_offsets_m']) for lap in laps):.2f}",
            f"{100 * np.mean([r['laps'][-1]['map_rms_m'] for r in races if r['laps']]):.1f}",
            f"{np.mean([r['wall']['real_time_factor'] for r in races]):.1f}",
        )
    return table


if __name__ == "__main__":
    sys.exit(main())
