"""How good planned laps are: time, bound, limits, and how long planning takes.

    python -m benchmarks.trajectories [--quick] [--json FILE]
                                      [--only bounds minsnap optimal warm generated]

Plans only, nothing is flown. Every lap is checked anew at 1 kHz from its positions
and yaw alone, by finite differences. Times are of one processor. What a lap is
meant to keep is in the titles; a lap that does not makes the exit code 1.
"""

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track as progress

from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.flight_limits import FlightLimits
from airrace.trajopt.flyable import clearance_of
from airrace.trajopt.gate_regions import turn_per_lap, unwrap_headings
from airrace.trajopt.min_snap.circuit import LEVEL, plan_circuit
from airrace.trajopt.min_snap.min_snap import DerivativeConstraint, solve_min_snap
from airrace.trajopt.time_optimal.lap_search import Effort
from airrace.trajopt.time_optimal.optimal_lap import plan_optimal_circuit
from airrace.trajopt.time_optimal.point_mass import point_mass_bound
from airrace.vehicle import DRONES, load_vehicle
from benchmarks.trajectory_tables import (
    MOST_LAP,
    MOST_TIME,
    MOST_WARM_GAP,
    MOST_WARM_TIME,
    MOVED,
    WORST_GAP,
    bounds_table,
    generated_table,
    min_snap_table,
    optimal_table,
    warm_table,
)
from tests.worlds.reference_laps import (
    CLEARANCE,
    LIMITS,
    ORIGINAL,
    POINT_MASS_CASES,
    WINDOW,
    load_course,
    regions,
)
from tests.worlds.rotor_check import rotor_shares

# Lap times that are to be kept (s): drone, limits, gates.
MOST = {
    ("Default", "original", "balls"): 21.0,
    ("Default", "original", "windows"): 19.3,
    ("StarOne", "original", "balls"): 21.0,
    ("StarOne", "original", "windows"): 19.3,
    ("Default", "rotor", "windows"): 10.0,
    ("StarOne", "rotor", "windows"): 12.6,
}
TOLERANCE = 0.005  # of a rotor's limit


def main(argv=None) -> int:
    """Plans everything and prints the tables; exit code 1 if a lap falls short."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer tracks and fewer moved gates")
    parser.add_argument(
        "--only",
        nargs="+",
        choices=list(SECTIONS),
        default=list(SECTIONS),
        help="these sections (default: all)",
    )
    parser.add_argument("--json", type=Path, help="also write all figures")
    args = parser.parse_args(argv)
    console, results = Console(width=160), {}
    for name in SECTIONS:
        if name in args.only:
            jobs, table = SECTIONS[name]
            jobs = jobs(args.quick)
            results[name] = [
                function(*arguments)
                for function, arguments in progress(
                    jobs, f"Planning: {name}", console=Console(stderr=True)
                )
            ]
            console.print(table(results[name]))
    if args.json is not None:
        args.json.write_text(json.dumps(results, indent=1))
    return 0 if all(row["ok"] for rows in results.values() for row in rows) else 1


def bound(name, limits, *expected) -> dict:
    """Compares the point-mass bounds of the reference track with what is published."""
    midpoints, headings, _ = load_course()
    row = {"limits": name, "ok": True}
    for kind, published in zip(("midpoints", "windows"), expected):
        clock = time.process_time()
        found = point_mass_bound(regions(kind, midpoints, headings), **limits)
        row[kind] = {
            "duration_s": found.duration,
            "published_s": published,
            "iterations": found.iterations,
            "cpu_s": time.process_time() - clock,
        }
        row["ok"] &= abs(found.duration / published - 1.0) < 0.003
    return row


def min_snap(dimensions: int) -> dict:
    """Plans the minimum-snap lap of the reference track."""
    midpoints, headings, pylons = load_course()
    best = point_mass_bound(regions("midpoints", midpoints, headings), **ORIGINAL).duration
    clock = time.process_time()
    lap = plan_circuit(midpoints, headings, pylons, dimensions, clearance=2.0, **ORIGINAL)
    cold = time.process_time() - clock
    clock = time.process_time()
    plan_circuit(midpoints, headings, pylons, dimensions, clearance=2.0, previous=lap, **ORIGINAL)
    warm_time = time.process_time() - clock
    return {
        "dimensions": dimensions,
        "duration_s": lap.duration,
        "gap": lap.duration / best - 1,
        "cpu_s": cold,
        "warm_cpu_s": warm_time,
        "solve_cpu_s": solve_time(midpoints, headings, dimensions, np.diff(lap.gate_times)),
        "ok": lap.duration <= MOST_LAP[dimensions],
    }


def solve_time(midpoints, headings, dimensions, durations) -> float:
    """Returns how long minimum snap takes for given durations, a median (s)."""
    waypoints, offset, times = np.array(midpoints), np.zeros(3), []
    if dimensions > 3:
        waypoints = np.column_stack([waypoints, unwrap_headings(headings)])
        offset = np.array([0.0, 0.0, 0.0, turn_per_lap(headings)])
    level = [DerivativeConstraint(i, 2, LEVEL) for i in range(len(midpoints))]
    for _ in range(21):
        clock = time.process_time()
        solve_min_snap(
            waypoints,
            durations,
            periodic=True,
            period_offset=offset,
            constraints=level if dimensions == 6 else (),
        )
        times.append(time.process_time() - clock)
    return float(np.median(times))


def optimal(drone, limits, kind, seed=None) -> dict:
    """Plans a time-optimal lap.

    Args:
        drone: its name.
        limits: "original" or "rotor".
        kind: of the gates, see regions().
        seed: see load_course(). On a generated track, clearance and windows are what
            the drone's size asks for.
    """
    midpoints, headings, pylons = load_course(seed)
    vehicle = load_vehicle(drone)[0]
    clearance = CLEARANCE if seed is None else clearance_of(vehicle.radius)
    window = (5.0 - clearance, WINDOW[1])
    row = {"drone": drone, "limits": limits, "gates": kind, "seed": seed, "count": len(headings)}
    clock = time.process_time()
    try:
        lap = plan_optimal_circuit(
            regions(kind, midpoints, headings, window),
            pylons,
            FlightLimits(vehicle, **LIMITS[limits]),
            clearance=clearance,
        )
    except TrajectoryOptimizationError as e:
        return row | {"fault": str(e), "ok": False}
    cpu = time.process_time() - clock
    check, shares = lap.report.check, rotor_shares(lap, vehicle)
    row |= {
        "duration_s": lap.duration,
        "bound_s": lap.report.bound,
        "gap": lap.report.gap,
        "iterations": lap.report.iterations,
        "cpu_s": cpu,
        "max_speed": check.max_speed,
        "max_acceleration": check.max_acceleration,
        "max_rate": check.max_rate,
        "bearing_deg": np.rad2deg(check.max_bearing),
        "clearance_m": check.clearance - clearance,
        "reached": list(check.reached),
        "least_share": shares[0],
        "most_share": shares[1],
    }
    sound = -TOLERANCE <= shares[0] and shares[1] <= 1.0 + TOLERANCE
    most = MOST.get((drone, limits, kind), np.inf) if seed is None else np.inf
    fast = lap.duration <= most and cpu <= (MOST_TIME if seed is None else np.inf)
    near = seed is None or row["gap"] <= WORST_GAP
    row["ok"] = bool(sound and fast and near and row["clearance_m"] > 0.0)
    return row


def warm(drone, limits, seed) -> dict:
    """Plans anew when the gates have moved, from the lap before and from nothing."""
    midpoints, headings, pylons = load_course()
    limits_of = FlightLimits(load_vehicle(drone)[0], **LIMITS[limits])
    rng = np.random.default_rng(seed)
    step = rng.normal(size=midpoints.shape)
    step *= MOVED / np.sqrt(np.mean(np.sum(step**2, axis=1)))
    moved = regions("windows", midpoints + step, headings)
    pylons_moved = pylons + np.repeat(step[:, :2], 2, axis=0)
    options = dict(clearance=CLEARANCE)
    old = plan_optimal_circuit(
        regions("windows", midpoints, headings), pylons, limits_of, **options
    )
    best = min(
        plan_optimal_circuit(
            moved,
            pylons_moved,
            limits_of,
            previous=previous,
            effort=Effort(iterations=30, tolerance=1e-4),
            **options,
        ).duration
        for previous in (None, old)
    )
    clock = time.process_time()
    lap = plan_optimal_circuit(moved, pylons_moved, limits_of, previous=old, **options)
    cpu = time.process_time() - clock
    gap = lap.duration / best - 1.0
    return {
        "drone": drone,
        "limits": limits,
        "seed": seed,
        "gap": gap,
        "cpu_s": cpu,
        "steps": lap.report.iterations,
        "ok": bool(gap <= MOST_WARM_GAP and cpu <= MOST_WARM_TIME),
    }


SECTIONS = {
    "bounds": (lambda quick: [(bound, tuple(each)) for each in POINT_MASS_CASES], bounds_table),
    "minsnap": (lambda quick: [(min_snap, (d,)) for d in (3, 4, 6)], min_snap_table),
    "optimal": (
        lambda quick: [
            (optimal, (drone, limits, kind))
            for drone in DRONES
            for limits in LIMITS
            for kind in ("balls", "windows")
        ],
        optimal_table,
    ),
    "warm": (
        lambda quick: [
            (warm, (drone, limits, seed))
            for drone in DRONES
            for limits in LIMITS
            for seed in range(2 if quick else 10)
        ],
        warm_table,
    ),
    "generated": (
        lambda quick: [
            (optimal, (drone, limits, "windows", seed))
            for drone in DRONES
            for limits in LIMITS
            for seed in range(3 if quick else 20)
        ],
        generated_table,
    ),
}

if __name__ == "__main__":
    sys.exit(main())
