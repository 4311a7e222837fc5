"""Lap times of whole races against the original system's.

    python -m benchmarks.lap_times [-t 3 4 6 optimal] [--limits original rotor]
                                   [--drone Default StarOne] [--laps 10] [--seeds 0 1 2]
                                   [--json FILE]

Every race is flown from pixels, with exploration, in the default scenario otherwise.
"""

import argparse
import itertools
import json
import sys
import tempfile
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from airrace.diagrams.runner import run_race
from airrace.scenario import TRAJECTORIES, Scenario, trajectory_name
from airrace.visualization.terminal import ORIGINAL_MEAN_LAP


def main(argv=None) -> int:
    """Flies the races and prints the table; exit code 1 if one did not finish."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "-t",
        "--trajectories",
        nargs="+",
        choices=TRAJECTORIES,
        default=TRAJECTORIES,
        help="of the lap planner (default: all)",
    )
    parser.add_argument(
        "--limits",
        nargs="+",
        default=["original"],
        help="original, rotor or v=..,a=.. (default: original)",
    )
    parser.add_argument(
        "--drone", nargs="+", default=["Default"], help="names or folders (default: Default)"
    )
    parser.add_argument("--laps", type=int, default=10, help="of each race (default: 10)")
    parser.add_argument(
        "--seeds", type=int, nargs="+", default=[0], help="one race each (default: 0)"
    )
    parser.add_argument("--json", type=Path, help="also write all race.json as one list")
    args = parser.parse_args(argv)
    races = list(itertools.product(args.drone, args.trajectories, args.limits, args.seeds))
    results = []
    for drone, trajectory, limits, seed in track(races, "Racing", console=Console(stderr=True)):
        with tempfile.TemporaryDirectory() as directory:
            scenario = Scenario(drone=drone, trajectory=trajectory, seed=seed, laps=args.laps)
            scenario.planner.limits, scenario.recording.content = limits, "none"
            scenario.check()
            results.append(run_race(scenario, Path(directory)))
    Console(width=160).print(make_table(results))
    if args.json is not None:
        args.json.write_text(json.dumps(results, indent=1))
    return 0 if all(r["finished"] for r in results) else 1


def make_table(results) -> Table:
    """Returns the table of a list of race.json, one row a drone, trajectory and limits."""
    table = Table(title="Laps of the reference track")
    for name in (
        "drone",
        "trajectory",
        "limits",
        "finished",
        "mean lap (s)",
        "best lap (s)",
        "planned over bound",
        "original (s)",
        "exploration (s)",
        "worst gate offset (m)",
        "map RMS (cm)",
        "collisions",
        "x real time",
    ):
        table.add_column(name, justify="right")
    groups = {}
    for race in results:
        key = (race["drone"], race["trajectory"], race["limits"])
        groups.setdefault(key, []).append(race)
    for (drone, trajectory, limits), races in groups.items():
        laps = [lap for r in races for lap in r["laps"]]
        row = [
            drone,
            trajectory_name(trajectory),
            limits,
            f"{sum(r['finished'] for r in races)}/{len(races)}",
        ]
        if laps:
            gaps = [lap["plan"]["over_bound"] for lap in laps if lap["plan"]]
            row += [
                f"{np.mean([lap['time_s'] for lap in laps]):.2f}",
                f"{min(lap['time_s'] for lap in laps):.2f}",
                f"{np.mean(gaps):.1%}" if gaps else "-",
                f"{ORIGINAL_MEAN_LAP[trajectory]:.2f}",
                f"{np.mean([r['exploration']['time_s'] for r in races]):.1f}",
                f"{max(max(lap['gate_offsets_m']) for lap in laps):.2f}",
                f"{100 * np.mean([r['laps'][-1]['map_rms_m'] for r in races if r['laps']]):.1f}",
                f"{sum(r['collisions'] for r in races)}",
                f"{np.mean([r['wall']['real_time_factor'] for r in races]):.1f}",
            ]
        table.add_row(*row)
    return table


if __name__ == "__main__":
    sys.exit(main())
