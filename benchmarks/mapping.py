"""How well the mapper finds the gates: error of its map against the truth.

    python -m benchmarks.mapping [--laps 3] [--seed 0] [--camera realistic] [--json FILE]

A camera flies one lap at the explorer's limits and some at the planner's, without
physics. The same pictures of it are measured twice, by OpenCV's own corners and poses and
as airrace does, and the same detections are mapped by both estimators.
"""

import itertools
import sys

from airrace.scenario import MAP_ESTIMATORS, Scenario
from airrace.scenario.camera_config import CameraConfig
from benchmarks import harness
from benchmarks.mapping_world import CORNERS, Errors, World

_REQUIRED = (  # what, case, phase, figure, at most (m, or a share)
    ("true pose, after exploration: mean error", "true pose", 0, "mean", 0.03),
    ("true pose, after exploration: worst marker", "true pose", 0, "worst", 0.08),
    ("true pose, after the laps: mean error", "true pose", 1, "mean", 0.02),
    ("true pose, after the laps: worst marker", "true pose", 1, "worst", 0.05),
    ("2 % gross outliers: worst marker", "outliers", 1, "worst", 0.08),
    ("good observations rejected: worst marker", "state noise", 1, "rejected", 0.20),
    ("with outliers as well", "outliers", 1, "rejected", 0.20),
)
# Robust than original, on the worst marker, with state noise: original drops outliers, too.
_TIMES_CLOSER = 2.0


def main(argv=None) -> int:
    """Prints the tables; exit code 1 if a requirement is not met."""
    parser = harness.make_parser(__doc__)
    parser.add_argument(
        "--laps", type=harness.count, default=3, help="after the exploration (default: 3)"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the noise (default: 0)")
    parser.add_argument(
        "--camera",
        choices=("clean", "realistic"),
        default="realistic",
        help="preset of the pictures (default: realistic)",
    )
    return harness.run(parser, argv, measure, show)


def measure(args) -> list:
    """Returns a row for all corners, cases and estimators: the figures of the two phases."""
    world = World(Scenario(camera=CameraConfig(preset=args.camera)))
    frames = world.frames(args.laps)
    cases = {
        "true pose": Errors(),
        "state noise": Errors(seed=args.seed),
        "outliers": Errors(seed=args.seed, outliers=0.02),
    }
    runs = list(itertools.product(CORNERS, cases, MAP_ESTIMATORS))
    return [
        {
            "corners": corners,
            "case": case,
            "estimator": estimator,
            "figures": world.map(frames, corners, estimator, cases[case]),
        }
        for corners, case, estimator in harness.progress(runs, "Mapping")
    ]


def show(rows: list) -> tuple[list, bool]:
    """Returns the tables, and whether all requirements are met."""
    figures = {(row["corners"], row["case"], row["estimator"]): row["figures"] for row in rows}
    checks = requirements(figures)
    columns = {
        "what": "{what}",
        "measured": "{measured}",
        "required": "{required}",
        "met": lambda row: "yes" if row["met"] else "NO",
    }
    title = "Required of the robust estimator (cm, %, times)"
    tables = [map_table(rows), harness.make_table(title, checks, columns)]
    return tables, all(check["met"] for check in checks)


def map_table(rows: list):
    """Returns the table of all rows, after the exploration and after the laps.

    Unseen: the worst board of which only the other boards of its gate tell. Rejected: the
    worst marker's share.
    """
    columns = {name: f"{{{name}}}" for name in ("corners", "case", "estimator")}
    for k, phase in enumerate(("expl.", "laps")):
        for name in ("mean", "worst", "unseen"):
            columns[f"{phase}\n{name}"] = lambda row, k=k, name=name: (
                f"{100 * row['figures'][k][name]:.2f}"
            )
        columns[f"{phase}\nrejected"] = f"{{figures[{k}][rejected]:.0%}}"
    title = "Error of the markers seen five times or more (cm)"
    return harness.make_table(title, rows, columns)


def requirements(figures: dict) -> list[dict]:
    """Returns a row for every requirement on the robust estimator: cm, per cent or times."""
    rows = []
    for what, case, phase, figure, limit in _REQUIRED:
        value = figures["refitted", case, "robust"][phase][figure]
        rows.append(_check(what, 100 * value, f"at most {100 * limit:.0f}", value <= limit))
    for corners in CORNERS:
        original, robust = (
            figures[corners, "state noise", estimator][1]["worst"]
            for estimator in ("original", "robust")
        )
        what = f"state noise, {corners} corners: robust closer than original"
        ratio = original / robust
        rows.append(_check(what, ratio, f"at least {_TIMES_CLOSER:.0f}", ratio >= _TIMES_CLOSER))
    return rows


def _check(what, value, required, met) -> dict:
    return {"what": what, "measured": f"{value:.2f}", "required": required, "met": met}


if __name__ == "__main__":
    sys.exit(main())
