"""How far planned and flown laps are from the optimum of the whole quadrotor.

    python -m benchmarks.oracle [--only reference hexagon generated 19-waypoints 19-gates 7-shapes]
        [--tracks 20] [--drone Default] [--limits rotor] [--share 1.0] [--drag 0] [--intervals 10]
        [--plan-only] [--workers N] [--json FILE]

For each track: the lap as it is planned, as it is flown on the true map by the controller, and the
quickest lap that the equations of motion allow, found by IPOPT (see quadrotor_optimum.py) with
the same limits of the drone, windows and clearance from pylons, the same lap after lap; but without
the camera's view. It is found on two meshes, of which the second is twice as fine: where both
agree, the optimum is that of the drone, not of the mesh. `19-waypoints`, `19-gates` and
`7-shapes` are published courses from rest to rest, with a published quadrotor, and only planned.

`--drag 1` is all of the drone's drag: planned and optimal laps know of it, flown ones learn it.
The optimum takes CasADi: `pip install 'airrace[benchmarks]'`.
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from airrace.diagrams.race import run_race
from airrace.evaluation.jobs import generated_track
from airrace.scenario import Scenario
from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.systems.planning.lap_planner import LapPlanner
from airrace.systems.planning.laps import PlanRequest
from airrace.systems.planning.map_margins import pylon_margins
from airrace.systems.planning.time_optimal_laps import TimeOptimalLaps
from airrace.track import load_track
from airrace.track.map_files import true_map
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.time_optimal.optimal_course import plan_optimal_course
from airrace.vehicle import Vehicle, load_vehicle
from airrace.vehicle.air import Air, air_vector
from benchmarks import harness, published_courses
from benchmarks.harness import make_table
from benchmarks.published_courses import COURSES
from benchmarks.quadrotor_optimum import (
    Flight,
    flight_of_course,
    flight_of_lap,
    optimum,
    require_casadi,
)

_TRACKS = {"reference": "student-airrace", "hexagon": "hexagon"}
_MESH = 2  # times as many intervals on the second one
_LAPS = 4  # flown: the last of them counts
_FIGURES = (
    *("planned_s", "planned_cpu_s", "flown_s", "optimum_s", "coarse_s", "iterations"),
    *("optimum_cpu_s", "planned_over", "flown_over"),
)


def main(argv=None) -> int:
    """Plans, flies and optimises, and prints the tables; exit code 1 if no optimum is found."""
    parser = harness.make_parser(__doc__)
    parser.add_argument(
        "--only",
        nargs="+",
        choices=[*_TRACKS, "generated", *COURSES],
        default=[*_TRACKS, "generated", *COURSES],
        help="(default: all)",
    )
    parser.add_argument(
        "--tracks", type=harness.count, default=20, help="generated (default: %(default)s)"
    )
    parser.add_argument("--drone", default="Default", help="(default: %(default)s)")
    parser.add_argument("--limits", default="rotor", help="see --limits of airrace race")
    parser.add_argument(
        "--share", type=float, default=1.0, help="of the rotors' thrust (default: all)"
    )
    parser.add_argument(
        "--drag", type=float, default=0.0, help="share of the drone's drag (default: none)"
    )
    parser.add_argument(
        "--intervals", type=harness.count, default=10, help="of each leg (default: %(default)s)"
    )
    parser.add_argument("--plan-only", action="store_true", help="fly nothing")
    parser.add_argument("--workers", type=harness.count, default=1, help="processes (default: 1)")
    return harness.run(parser, argv, measure, show)


def measure(args) -> dict:
    """Returns rows of lap(), and of course()."""
    require_casadi()
    jobs = [(lap, (_TRACKS[name], name, args)) for name in args.only if name in _TRACKS]
    if "generated" in args.only:
        jobs += [(generated_lap, (seed, args)) for seed in range(args.tracks)]
    courses = [(course, (name, args)) for name in args.only if name in COURSES]
    rows = harness.in_processes([*jobs, *courses], "Optimising", workers=args.workers)
    return {"laps": rows[: len(jobs)], "courses": rows[len(jobs) :]}


def show(results: dict) -> tuple[list, bool]:
    """Returns the tables, and whether every optimum was found."""
    meshes = {
        "optimum (s)": "{optimum_s:.3f}",
        "on half the mesh": "{coarse_s:.3f}",
        "found": "{converged}",
        "time (s)": "{optimum_cpu_s:.0f}",
    }
    laps = {
        "track": "{name}",
        "planned (s)": "{planned_s:.3f}",
        "time to plan (s)": "{planned_cpu_s:.2f}",
        "flown (s)": "{flown_s:.3f}",
        **meshes,
        "planned, over": "{planned_over:.2%}",
        "flown, over": "{flown_over:.2%}",
    }
    courses = {
        "course": "{name}",
        "planned (s)": "{planned_s:.3f}",
        "time to plan (s)": "{planned_cpu_s:.1f}",
        **meshes,
        "planned, over": "{planned_over:.2%}",
        "others (s)": "{others}",
    }
    tables = [
        make_table(title, results[key], columns)
        for key, title, columns in (
            ("laps", "Laps: planned, flown on the true map, and optimal", laps),
            ("courses", "Published courses: planned, optimal, and others'", courses),
        )
        if results[key]
    ]
    return tables, all(row["converged"] for rows in results.values() for row in rows)


def generated_lap(seed: int, args) -> dict:
    """Returns the row of a generated track, as lap() does."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "track.yaml"
        file.write_text(generated_track(seed)[1], encoding="utf-8")
        return lap(str(file), f"generated, {seed}", args)


def lap(track: str, name: str, args) -> dict:
    """Returns the row of a track: planned, flown, optimal; NaN if no lap is found.

    Args: track: as a scenario has it. name: in the table. args: options of the command line.
    """
    scenario = _scenario(track, args)
    clock = time.process_time()
    laps = _laps(scenario)
    try:
        planned = laps.lap(None)
    except TrajectoryOptimizationError:
        return {"name": name, "converged": False} | dict.fromkeys(_FIGURES, np.nan)
    cpu = time.process_time() - clock
    row = {"name": name, "planned_s": planned.duration, "planned_cpu_s": cpu}
    row["flown_s"] = np.nan if args.plan_only else _flown(scenario)
    vehicle = laps.constraints.limits.vehicle
    guess = flight_of_lap(planned, planned.gate_times, vehicle, args.intervals)
    return _compared(row, guess, laps.gates, laps.constraints, args.drag)


def course(name: str, args) -> dict:
    """Returns the row of a published course: planned, optimal, others'."""
    make_gates, others = COURSES[name]
    gates, constraints = make_gates(), published_courses.constraints()
    clock = time.process_time()
    planned = plan_optimal_course(gates, constraints)
    cpu = time.process_time() - clock
    row = {
        "name": name,
        "planned_s": planned.duration,
        "planned_cpu_s": cpu,
        "flown_s": np.nan,
        "others": ", ".join(f"{planner} {seconds:.2f}" for planner, seconds in others.items()),
    }
    guess = flight_of_course(planned, args.intervals)
    return _compared(row, guess, gates, constraints, 0.0)


def _compared(row: dict, guess: Flight, gates, constraints, drag: float) -> dict:
    """Returns a row with the optimum near a guess, on two meshes."""
    coarse = optimum(guess, gates, constraints, drag)
    fine = optimum(coarse.flight.refined(_MESH), gates, constraints, drag)
    best = fine.flight.duration
    return row | {
        "optimum_s": best,
        "coarse_s": coarse.flight.duration,
        "converged": coarse.converged and fine.converged,
        "iterations": coarse.iterations + fine.iterations,
        "optimum_cpu_s": coarse.cpu + fine.cpu,
        "planned_over": row["planned_s"] / best - 1.0,
        "flown_over": row["flown_s"] / best - 1.0,
    }


def _scenario(track: str, args) -> Scenario:
    """Returns a race on the true map, without pictures."""
    scenario = Scenario(
        trajectory="optimal", track=track, drone=args.drone, laps=_LAPS, map="track"
    )
    scenario.planner.limits, scenario.planner.thrust_share = args.limits, args.share
    scenario.camera.renderer, scenario.recording.content = "none", "none"
    scenario.disturbances.drag = args.drag
    return scenario


def _laps(scenario: Scenario) -> TimeOptimalLaps:
    """Returns what plans the laps of such a race once the map is known."""
    gate_map, vehicle = true_map(load_track(scenario.track)), load_vehicle(scenario.drone)[0]
    request = PlanRequest(
        start_time=0.0,
        gates=gate_map.gates,
        pylons=np.array([gate.pylons for gate in gate_map.gates]).reshape(-1, 2),
        margins=pylon_margins(gate_map.gates, gate_map.markers),
        start=np.zeros((5, 4)),
        old=NO_PLAN,
        rotor_factors=np.ones(len(vehicle.rotors)),
        air=_air(vehicle, scenario.disturbances.drag),
    )
    return TimeOptimalLaps(LapPlanner.from_scenario(scenario).problem_of(request))


def _air(vehicle: Vehicle, share: float) -> np.ndarray:
    """Returns the vector of the Air in which a share of a vehicle's drag acts, without wind."""
    linear, quadratic = (
        share * np.array(c) / vehicle.mass for c in (vehicle.drag.linear, vehicle.drag.quadratic)
    )
    axial = linear[2] - linear[0], quadratic[2] - quadratic[0]
    return air_vector(Air(linear[0], quadratic[0], np.zeros(3), *axial))


def _flown(scenario: Scenario) -> float:
    """Returns what the last lap of a race takes (s); NaN if the race does not end well."""
    with tempfile.TemporaryDirectory() as folder:
        result = run_race(scenario, Path(folder))
    return result["laps"][-1]["time_s"] if result["finished"] else np.nan


if __name__ == "__main__":
    sys.exit(main())
