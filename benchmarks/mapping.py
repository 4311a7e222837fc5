"""How well the mapper finds the gates: error of its map against the truth.

    python -m benchmarks.mapping [--laps 3] [--seed 0] [--camera realistic] [--json FILE]

A camera flies one lap at the explorer's limits and some at the planner's, without
physics. The same pictures of it are measured twice, by OpenCV's own corners and by
refitted ones, and the same detections are mapped by both estimators.
"""

import argparse
import json
import sys
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console
from rich.progress import track as progress
from rich.table import Table

from airrace.scenario import ESTIMATORS, Scenario
from airrace.scenario.camera import CameraConfig
from benchmarks.mapping_world import CORNERS, World

_OFFSET = 0.010  # s, between image and pose
_REQUIRED = (  # what, case, phase, figure, at most (m, or a share)
    ("true pose, after exploration: mean error", "true pose", 0, "mean", 0.03),
    ("true pose, after exploration: worst marker", "true pose", 0, "worst", 0.08),
    ("true pose, after the laps: mean error", "true pose", 1, "mean", 0.02),
    ("true pose, after the laps: worst marker", "true pose", 1, "worst", 0.05),
    ("2 % gross outliers: worst marker", "outliers", 1, "worst", 0.08),
    ("good observations rejected: worst marker", "state noise", 1, "rejected", 0.20),
    ("with outliers as well", "outliers", 1, "rejected", 0.20),
)
_TIMES_CLOSER = 3.0  # robust than report, on the worst marker, with state noise


def main(argv=None) -> int:
    """Prints the tables; exit code 1 if a requirement is not met."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--laps", type=int, default=3, help="after the exploration (default: 3)")
    parser.add_argument("--seed", type=int, default=0, help="of the noise (default: 0)")
    parser.add_argument(
        "--camera",
        choices=("clean", "realistic"),
        default="realistic",
        help="preset of the pictures (default: realistic)",
    )
    parser.add_argument("--json", type=Path, help="also write all figures")
    args = parser.parse_args(argv)
    cv2.setNumThreads(1)
    world = World(Scenario(camera=CameraConfig(preset=args.camera)))
    progress_bar = Console(stderr=True)
    frames = world.frames(args.laps, progress_bar)
    cases = {
        "true pose": {},
        "state noise": {"seed": args.seed},
        "outliers": {"seed": args.seed, "outliers": 0.02},
        "late": {"offset": _OFFSET},
    }
    runs = [
        (corners, case, estimator)
        for corners in (*CORNERS, "exact")
        for case in cases
        for estimator in ESTIMATORS
        if corners != "exact" or case == "late"
    ]
    results = {
        (corners, case, estimator): world.map(frames, corners, estimator, **cases[case])
        for corners, case, estimator in progress(runs, "Mapping", console=progress_bar)
    }
    console = Console(width=130)
    rows = requirements(results)
    for table in (map_table(results), offset_table(results), requirements_table(rows)):
        console.print(table)
    if args.json is not None:
        args.json.write_text(
            json.dumps(
                [
                    {"corners": c, "case": case, "estimator": e, "figures": figures}
                    for (c, case, e), figures in results.items()
                ],
                indent=1,
            )
        )
    return 0 if all(row[-1] for row in rows) else 1


def map_table(results: dict) -> Table:
    """Returns the table of all runs on pictures.

    Args:
        results: (corners, case, estimator) to the figures of the two phases.
    """
    table = Table(title="Error of the markers seen five times or more (cm)")
    for name in ("corners", "case", "estimator"):
        table.add_column(name)
    # After the exploration, and after the laps. Unseen: the worst board of which
    # only the other boards of its gate tell. Rejected: the worst marker's share.
    for phase in ("expl.", "laps"):
        for name in ("mean", "worst", "unseen", "rejected"):
            table.add_column(f"{phase}\n{name}", justify="right")
    for (corners, case, estimator), phases in results.items():
        if corners in CORNERS:
            table.add_row(
                corners,
                case,
                estimator,
                *(
                    cell
                    for f in phases
                    for cell in (
                        *(f"{100 * f[name]:.2f}" for name in ("mean", "worst", "unseen")),
                        f"{f['rejected']:.0%}",
                    )
                ),
            )
    return table


def offset_table(results: dict) -> Table:
    """Returns the table of what poses that are too old do to the map, by marker.

    Predicted is what they do to perfect observations of the same markers; measured is
    on refitted corners.
    """
    table = Table(title=f"Shift of the map by poses {1000 * _OFFSET:.0f} ms too old (cm)")
    for name in ("estimator", "predicted, mean", "measured, mean", "worst difference"):
        table.add_column(name, justify="left" if name == "estimator" else "right")
    for estimator in ESTIMATORS:
        late, on_time, exact = (
            results[corners, case, estimator][1]["errors"]
            for corners, case in (
                ("refitted", "late"),
                ("refitted", "true pose"),
                ("exact", "late"),
            )
        )
        common = sorted(late.keys() & on_time.keys() & exact.keys())
        measured = np.array([np.subtract(late[id], on_time[id]) for id in common])
        predicted = np.array([exact[id] for id in common])
        table.add_row(
            estimator,
            *(
                f"{100 * value:.1f}"
                for value in (
                    np.linalg.norm(predicted, axis=1).mean(),
                    np.linalg.norm(measured, axis=1).mean(),
                    np.linalg.norm(measured - predicted, axis=1).max(),
                )
            ),
        )
    return table


def requirements(results: dict) -> list[tuple]:
    """Returns (what, measured, limit, met) of every requirement on the robust estimator."""
    rows = []
    for what, case, phase, figure, limit in _REQUIRED:
        value = results["refitted", case, "robust"][phase][figure]
        rows.append((what, f"{100 * value:.2f}", f"at most {100 * limit:.0f}", value <= limit))
    for corners in CORNERS:
        report, robust = (
            results[corners, "state noise", estimator][1]["worst"]
            for estimator in ("report", "robust")
        )
        rows.append(
            (
                f"state noise, {corners} corners: robust closer than report",
                f"{report / robust:.1f}",
                f"at least {_TIMES_CLOSER:.0f}",
                report >= _TIMES_CLOSER * robust,
            )
        )
    return rows


def requirements_table(rows) -> Table:
    """Returns the table of requirements(): cm, per cent or times."""
    table = Table(title="Required of the robust estimator (cm, %, times)")
    for name in ("what", "measured", "required", "met"):
        table.add_column(name, justify="left" if name == "what" else "right")
    for what, measured, required, met in rows:
        table.add_row(what, measured, required, "yes" if met else "NO")
    return table


if __name__ == "__main__":
    sys.exit(main())
