"""How good planned laps are: time, bound, limits, and how long planning takes.

    python -m benchmarks.trajectories [--quick] [--json FILE]
                                      [--only bounds minsnap optimal warm generated]

Plans only, nothing is flown. Every lap is checked anew at 1 kHz from its positions
and yaw alone, by finite differences. Times are of one processor. What a lap is
meant to keep is in the titles; a lap that does not makes the exit code 1.
"""

import itertools
import sys
import time

import numpy as np

from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.feasibility import clearance_of
from airrace.trajopt.flight_limits import FlightConstraints, FlightLimits
from airrace.trajopt.min_snap.circuit import plan_circuit
from airrace.trajopt.time_optimal.lap_search import Effort
from airrace.trajopt.time_optimal.optimal_lap import plan_optimal_circuit
from airrace.vehicle import RACERS, load_vehicle
from benchmarks import harness
from benchmarks.harness import column, groups, make_table
from tests.worlds.published_laps import (
    CLEARANCE,
    LIMITS,
    ORIGINAL,
    POINT_MASS_CASES,
    WINDOW,
    PointMassCase,
    PointMassLimits,
    exact_bound,
    load_course,
    regions,
)
from tests.worlds.rotor_check import greatest_bearing, rotor_shares

# Lap times that are to be kept (s): of minimum snap by dimensions, and of time-optimal laps by
# drone, limits, gates.
MOST_LAP = {3: 22.5, 4: 23.0, 6: 32.0}
MOST = {
    ("Default", "original", "balls"): 21.0,
    ("Default", "original", "windows"): 19.3,
    ("StarOne", "original", "balls"): 21.0,
    ("StarOne", "original", "windows"): 19.3,
    ("Default", "rotor", "windows"): 10.0,
    ("StarOne", "rotor", "windows"): 12.6,
}
MOST_TIME, MOST_WARM_TIME = 5.0, 0.5  # s to plan, from nothing and from another lap
MOST_WARM_GAP = 0.02  # of the converged lap time
MEDIAN_GAP, WORST_GAP = 0.02, 0.04  # over the bound, of generated tracks
TOLERANCE = 0.005  # of a rotor's limit
MOVED = 0.3  # m, RMS


def main(argv=None) -> int:
    """Plans everything and prints the tables; exit code 1 if a lap falls short."""
    parser = harness.make_parser(__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer tracks and fewer moved gates")
    parser.add_argument(
        "--only",
        nargs="+",
        choices=list(SECTIONS),
        default=list(SECTIONS),
        help="these sections (default: all)",
    )
    return harness.run(parser, argv, measure, show)


def measure(args) -> dict:
    """Returns the rows of every section."""
    results = {}
    for name in SECTIONS:
        if name in args.only:
            plan, cases, _ = SECTIONS[name]
            cases = harness.progress(cases(args.quick), f"Planning: {name}")
            results[name] = [plan(*case) for case in cases]
    return results


def show(results: dict) -> tuple[list, bool]:
    """Returns the tables, and whether all laps are as they should be."""
    tables = [SECTIONS[name][2](rows) for name, rows in results.items()]
    return tables, all(row["ok"] for rows in results.values() for row in rows)


def point_mass(case: PointMassCase) -> dict:
    """Compares the point-mass bounds of the track student-airrace with what is published."""
    midpoints, headings, _ = load_course()
    row = {"limits": case.name, "ok": True}
    for kind in ("midpoints", "windows"):
        published, clock = getattr(case, kind), time.process_time()
        found = exact_bound(regions(kind, midpoints, headings), PointMassLimits(**case.limits))
        row[kind] = {
            "duration_s": found.duration,
            "published_s": published,
            "cpu_s": time.process_time() - clock,
        }
        row["ok"] &= abs(found.duration / published - 1.0) < 0.003
    return row


def point_mass_table(rows):
    """Returns the table of point_mass()."""
    columns = {"limits": "{limits}"}
    for kind in ("midpoints", "windows"):
        columns |= {
            f"{kind} (s)": f"{{{kind}[duration_s]:.3f}}",
            f"{kind}, published": f"{{{kind}[published_s]:.2f}}",
            f"{kind}, time (s)": f"{{{kind}[cpu_s]:.2f}}",
        }
    title = "Lap of a point mass on the track student-airrace (bound: 0.3 % off what is published)"
    return make_table(title, rows, columns)


def min_snap(dimensions: int) -> dict:
    """Plans the minimum-snap lap of the track student-airrace."""
    midpoints, headings, pylons = load_course()
    best = exact_bound(
        regions("midpoints", midpoints, headings), PointMassLimits(**ORIGINAL)
    ).duration
    constraints = FlightConstraints(
        pylons, 2.0, FlightLimits(load_vehicle("Default")[0], **ORIGINAL)
    )
    clock = time.process_time()
    lap = plan_circuit(midpoints, headings, dimensions, constraints)
    cold = time.process_time() - clock
    clock = time.process_time()
    plan_circuit(midpoints, headings, dimensions, constraints, previous=lap)
    return {
        "dimensions": dimensions,
        "duration_s": lap.duration,
        "gap": lap.duration / best - 1.0,
        "cpu_s": cold,
        "warm_cpu_s": time.process_time() - clock,
        "ok": lap.duration <= MOST_LAP[dimensions],
    }


def min_snap_table(rows):
    """Returns the table of min_snap()."""
    columns = {
        "dimensions": "{dimensions}",
        "lap (s)": "{duration_s:.2f}",
        "over the bound": "{gap:.1%}",
        "time (s)": "{cpu_s:.2f}",
        "from itself (s)": "{warm_cpu_s:.2f}",
    }
    title = (
        "Minimum-snap laps of the track student-airrace, through the midpoints within "
        "20 m/s and 10 m/s^2 (bounds: 22.5, 23, 32 s)"
    )
    return make_table(title, rows, columns)


def optimal(drone: str, limits: str, kind: str, seed: int | None = None) -> dict:
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
    gates = regions(kind, midpoints, headings, (5.0 - clearance, WINDOW[1]))
    row = {"drone": drone, "limits": limits, "gates": kind, "seed": seed}
    clock = time.process_time()
    try:
        lap = plan_optimal_circuit(
            gates, FlightConstraints(pylons, clearance, FlightLimits(vehicle, **LIMITS[limits]))
        )
    except TrajectoryOptimizationError as e:
        return row | {"fault": str(e), "ok": False}
    cpu = time.process_time() - clock
    check, (least, most) = lap.summary.check, rotor_shares(lap, vehicle)
    row |= {
        "duration_s": lap.duration,
        "bound_s": lap.summary.bound,
        "gap": lap.duration / lap.summary.bound - 1.0,
        "iterations": lap.summary.iterations,
        "cpu_s": cpu,
        "max_speed": check.max_speed,
        "max_acceleration": check.max_acceleration,
        "max_rate": check.max_rate,
        "bearing_deg": np.rad2deg(greatest_bearing(lap, midpoints)),
        "clearance_m": check.clearance - clearance,
        "least_share": least,
        "most_share": most,
    }
    good = -TOLERANCE <= least and most <= 1.0 + TOLERANCE and row["clearance_m"] > 0.0
    if seed is None:
        good &= lap.duration <= MOST.get((drone, limits, kind), np.inf) and cpu <= MOST_TIME
    else:
        good &= row["gap"] <= WORST_GAP
    return row | {"ok": bool(good)}


def optimal_table(rows):
    """Returns the table of optimal() on the track student-airrace."""
    columns = {
        "drone": "{drone}",
        "limits": "{limits}",
        "gates": "{gates}",
        "lap (s)": lambda row: row.get("fault") or f"{row['duration_s']:.2f}",
        "bound (s)": "{bound_s:.2f}",
        "over": "{gap:.2%}",
        "steps": "{iterations}",
        "time (s)": "{cpu_s:.2f}",
        "speed (m/s)": "{max_speed:.1f}",
        "accel. (m/s^2)": "{max_acceleration:.1f}",
        "rates (rad/s)": "{max_rate:.1f}",
        "rotors": "{least_share:.1%} .. {most_share:.1%}",
        "gate off axis (deg)": "{bearing_deg:.1f}",
    }
    title = (
        "Time-optimal laps of student-airrace, balls of 0.4 m or windows of 3.2 by 2.5 m to "
        f"each side\n(bounds: {MOST_TIME:g} s to plan; original: balls 21.0 s, windows 19.3 s; "
        "rotor windows: Default 10.0 s; rotors within their limits by 0.5 %)"
    )
    return make_table(title, rows, columns)


def warm(drone: str, limits: str, seed: int) -> dict:
    """Plans anew when the gates have moved, from the lap before and from nothing."""
    midpoints, headings, pylons = load_course()
    limits_of = FlightLimits(load_vehicle(drone)[0], **LIMITS[limits])
    rng = np.random.default_rng(seed)
    step = rng.normal(size=midpoints.shape)
    step *= MOVED / np.sqrt(np.mean(np.sum(step**2, axis=1)))
    moved = (
        regions("windows", midpoints + step, headings),
        FlightConstraints(pylons + np.repeat(step[:, :2], 2, axis=0), CLEARANCE, limits_of),
    )
    old = plan_optimal_circuit(
        regions("windows", midpoints, headings), FlightConstraints(pylons, CLEARANCE, limits_of)
    )
    effort = Effort(iterations=30, tolerance=1e-4)
    best = min(
        plan_optimal_circuit(*moved, previous=start, effort=effort).duration
        for start in (None, old)
    )
    clock = time.process_time()
    lap = plan_optimal_circuit(*moved, previous=old)
    cpu, gap = time.process_time() - clock, lap.duration / best - 1.0
    return {
        "drone": drone,
        "limits": limits,
        "seed": seed,
        "gap": gap,
        "cpu_s": cpu,
        "steps": lap.summary.iterations,
        "ok": bool(gap <= MOST_WARM_GAP and cpu <= MOST_WARM_TIME),
    }


def warm_table(rows):
    """Returns the table of warm()."""
    title = (
        f"Gates moved by {MOVED} m RMS, planned from the lap before "
        f"(bounds: {MOST_WARM_GAP:.0%} of the converged lap in {MOST_WARM_TIME:g} s)"
    )
    return make_table(title, _by_limits(rows), _GROUP_COLUMNS)


_GROUP_COLUMNS = {
    "drone": "{drone}",
    "limits": "{limits}",
    "planned": "{planned}/{laps}",
    "over, mean": "{mean_gap:.2%}",
    "median": "{median_gap:.2%}",
    "worst": "{worst_gap:.2%}",
    "time, mean (s)": "{mean_s:.2f}",
    "worst (s)": "{worst_s:.2f}",
}


def _by_limits(rows) -> list:
    summary = []
    for (drone, limits), group in groups(rows, "drone", "limits"):
        made = [row for row in group if "fault" not in row]
        row = {"drone": drone, "limits": limits, "planned": len(made), "laps": len(group)}
        if made:
            gaps, cpu = column(made, "gap"), column(made, "cpu_s")
            row |= {"mean_gap": gaps.mean(), "median_gap": np.median(gaps)}
            row |= {"worst_gap": gaps.max(), "mean_s": cpu.mean(), "worst_s": cpu.max()}
        if made and "least_share" in made[0]:
            row["least_share"] = column(made, "least_share").min()
            row |= {key: column(made, key).max() for key in ("most_share", "bearing_deg")}
        summary.append(row)
    return summary


def generated_table(rows):
    """Returns the table of optimal() on generated tracks."""
    more = {
        "rotors": "{least_share:.1%} .. {most_share:.1%}",
        "gate off axis, worst (deg)": "{bearing_deg:.1f}",
    }
    title = (
        "Time-optimal laps of generated tracks (bounds: over a point mass that keeps "
        f"clear of the pylons, too, by {MEDIAN_GAP:.0%} in the median, {WORST_GAP:.0%} "
        "at worst)"
    )
    return make_table(title, _by_limits(rows), _GROUP_COLUMNS | more)


def _product(*values) -> list:
    return list(itertools.product(RACERS, LIMITS, *values))


# Name to what plans, its cases (quick or not), and the table of its rows.
SECTIONS = {
    "bounds": (point_mass, lambda quick: [(case,) for case in POINT_MASS_CASES], point_mass_table),
    "minsnap": (min_snap, lambda quick: [(3,), (4,), (6,)], min_snap_table),
    "optimal": (optimal, lambda quick: _product(("balls", "windows")), optimal_table),
    "warm": (warm, lambda quick: _product(range(2 if quick else 10)), warm_table),
    "generated": (
        optimal,
        lambda quick: _product(("windows",), range(3 if quick else 20)),
        generated_table,
    ),
}

if __name__ == "__main__":
    sys.exit(main())
