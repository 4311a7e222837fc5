"""Measures what the tables of the documentation show, anew.

    python -m benchmarks.documented [--only NAME ...] [--workers N] [--folder DIR]

Runs the benchmarks below one after the other, and writes the tables of each to NAME.json in
docs/measurements/, with the command, the commit, the machine and the date. The pages are made
from these files. It takes hours; figures of speed need a machine without other work.
A benchmark whose bounds are broken says so, and its tables are written all the same.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

from airrace.common.errors import exit_code
from airrace.common.files import write_json
from benchmarks import harness

FOLDER = Path(__file__).parents[1] / "docs" / "measurements"
# The name of the file, and what is run; {workers} is the option.
BENCHMARKS = {
    "student_airrace": (
        "races",
        "--only",
        "student-airrace",
        "--runs",
        "2",
        "--workers",
        "{workers}",
    ),
    "generated": ("races", "--only", "generated", "--tracks", "5", "--workers", "{workers}"),
    "generated_rotor": (
        *("races", "--only", "generated", "--levels", "1", "2", "3", "--tracks", "200"),
        *("--scenario_text", "{{planner: {{limits: rotor}}}}", "--workers", "{workers}"),
    ),
    "original": ("original", "--workers", "{workers}"),
    "oracle": ("oracle", "--workers", "{workers}"),
    "at_the_limit": (
        *("at_the_limit", "--levels", "1", "2", "3", "--runs", "2", "--laps", "4"),
        *("--workers", "{workers}"),
    ),
    "at_the_limit_pixels": (
        *("at_the_limit", "--pixels", "--only", "all parts", "--levels", "2", "3"),
        *("--runs", "10", "--laps", "4", "--speed-runs", "1", "--workers", "{workers}"),
    ),
    "betaflight": ("betaflight",),
    "control": ("control", "--workers", "{workers}"),
    "perception": ("perception",),
    "mapping": ("mapping",),
    "exploration": ("exploration", "--workers", "{workers}"),
    "exploration_steps": (
        *("exploration", "--step_length", "2", "5", "10", "15", "25"),
        *("--student_airrace", "--tracks", "40", "--workers", "{workers}"),
    ),
    "estimation": (
        "estimation",
        "--only",
        "student-airrace",
        "--seeds",
        "20",
        "--workers",
        "{workers}",
    ),
    "estimation_kinds": (
        *("estimation", "--only", "kinds", "--seeds", "10", "--laps", "3"),
        *("--workers", "{workers}"),
    ),
    **{
        f"estimation_level_{level}": (
            *("estimation", "--only", "generated", "--levels", str(level)),
            *("--tracks", str(tracks), "--workers", "{workers}"),
        )
        for level, tracks in ((1, 200), (3, 200), (4, 20))
    },
    "estimation_harsh": (
        *("estimation", "--only", "generated", "--levels", "1", "--preset", "harsh"),
        *("--tracks", "20", "--workers", "{workers}"),
    ),
    "estimation_ablations": (
        *("estimation", "--only", "ablations", "--seeds", "4", "--laps", "3"),
        *("--workers", "{workers}"),
    ),
    "trajectories": ("trajectories",),
    "tracks": ("tracks",),
    "hitl": ("hitl",),
    "grand_prix": ("grand_prix", "--only", "rates", "soak", "malformed", "reset"),
    "grand_prix_courses": ("grand_prix", "--only", "courses", "--tracks", "20", "--twice"),
    "race_speed": ("race_speed", "--laps", "3", "--runs", "5"),
    "race_speed_estimators": (
        *("race_speed", "--laps", "3", "--runs", "7"),
        *("--estimators", "truth", "vio"),
    ),
    "race_speed_on_a_map": ("race_speed", "--renderer", "none", "--laps", "10", "--runs", "5"),
    "race_speed_vtk": ("race_speed", "--renderer", "vtk", "--laps", "1"),
    "growth": ("growth", "--runs", "3"),
    "vtk_frame": ("vtk_frame",),
    "peers": ("peers", "--install"),
    **{
        f"policies_level_{level}": (
            *("policies", "--levels", str(level), "--tracks", "200", "--workers", "{workers}"),
        )
        for level in (1, 3)
    },
    "envs": ("envs", "--peers"),
}


def main(argv=None) -> int:
    """Runs the benchmarks; exit code 1 if one wrote no tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--only", nargs="+", choices=BENCHMARKS, default=list(BENCHMARKS), help="(default: all)"
    )
    parser.add_argument("--workers", type=harness.count, default=1, help="processes (default: 1)")
    parser.add_argument(
        "--folder", type=Path, default=FOLDER, help="for the tables (default: docs/measurements)"
    )
    args = parser.parse_args(argv)

    def program():
        # All of them, even after a fault.
        written = [measure(name, args.workers, args.folder) for name in args.only]
        return 0 if all(written) else 1

    return exit_code(program)


def measure(name: str, workers: int, folder: Path) -> bool:
    """Runs a benchmark and writes its tables; returns whether there are any.

    Args:
        name: of BENCHMARKS.
        workers: number of processes, where a benchmark can use several.
        folder: for the tables; it is made.
    """
    module, *options = (word.format(workers=workers) for word in BENCHMARKS[name])
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch) / "figures.json"
        command = [sys.executable, "-m", f"benchmarks.{module}", *options, "--json", str(file)]
        subprocess.run(command, check=False)
        if not file.exists():
            return False
        written = json.loads(file.read_text(encoding="utf-8"))
    del written["figures"]  # of every single view and flight
    folder.mkdir(exist_ok=True)
    write_json(folder / f"{name}.json", written)
    return True


if __name__ == "__main__":
    sys.exit(main())
