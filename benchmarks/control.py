"""How well the drones are controlled: recovery, tracking, wind, lost rotors.

    python -m benchmarks.control [--quick] [--only recovery tracking wind loss]
                                 [--json FILE] [--workers N]

Bounds in the titles are what the controller is meant to keep. All but the races
fly with the control alone, along a reference, and start in the air. The results
do not depend on the number of workers.
"""

import itertools
import sys

import numpy as np

from airrace.common.processes import processors
from airrace.vehicle import RACERS, load_vehicle
from benchmarks import harness
from benchmarks.experiments import MAX_RATE, Case, loss, race, recovery, tracking
from benchmarks.harness import groups, make_table, worst
from tests.worlds.flight import racing_lap

_NOISES = ("none", "nominal")
_NO_REJECTION = "controller: {disturbance_rejection: false}"
_TRACKING_CASES = (
    Case("nominal"),
    Case("feed-forward off", text="controller: {feed_forward: false}"),
    Case("disturbance rejection off", text=_NO_REJECTION),
    Case("drag", text="disturbances: {drag: 1.0}"),
    Case(
        "drag, disturbance rejection off", text=f"{{disturbances: {{drag: 1.0}}, {_NO_REJECTION}}}"
    ),
    Case("wind and drag", "Wind", seeds=5),
    Case("wind and drag, disturbance rejection off", "Wind", _NO_REJECTION, 5),
    Case(
        "errors of 10 %, 10 ms delay",
        text="disturbances: {mass_error: 0.1, inertia_error: 0.1, "
        "thrust_coefficient_error: 0.1, actuator_delay: 0.01}",
        seeds=5,
    ),
)
_PHASES = (0.0, 0.25, 0.5, 0.75)  # of the lap
_DRAGS = {0.0: "without drag", 1.0: "with drag"}
_FAILING_ROTOR, _FAILURE_TIMES = 3, (60.0, 120.0)  # number, s
# Drake's Python systems and their diagram hold each other, so that no flight is ever freed:
# after so many flights, new processes go on.
_FLIGHTS_EACH = 100


def main(argv=None) -> int:
    """Flies everything and prints the tables; exit code 1 if a race did not finish."""
    parser = harness.make_parser(__doc__)
    parser.add_argument(
        "--quick", action="store_true", help="a tenth of the attitudes, one seed, races of one lap"
    )
    parser.add_argument(
        "--attitudes", type=harness.count, help="for each drone and noise (default: 200)"
    )
    parser.add_argument(
        "--only",
        nargs="+",
        choices=list(SECTIONS),
        default=list(SECTIONS),
        help="these sections (default: all)",
    )
    parser.add_argument(
        "--workers",
        type=harness.count,
        default=processors(),
        help="processes (default: one a processor)",
    )
    return harness.run(parser, argv, measure, show)


def measure(args) -> dict:
    """Returns the rows of every section."""
    jobs = {name: SECTIONS[name][0](args) for name in SECTIONS if name in args.only}
    rows = iter(
        harness.in_processes(
            itertools.chain(*jobs.values()), "Flying", workers=args.workers, jobs_each=_FLIGHTS_EACH
        )
    )
    return {name: list(itertools.islice(rows, len(jobs[name]))) for name in jobs}


def show(results: dict) -> tuple[list, bool]:
    """Returns the tables of all sections, and whether all races finished."""
    tables = [table for name, rows in results.items() for table in SECTIONS[name][1](rows)]
    flown = itertools.chain(*results.values())
    return tables, all(row.get("finished", True) for row in flown)


def recovery_jobs(args) -> list:
    """Returns the jobs that recover from attitudes and angular velocities."""
    indices = range(args.attitudes or (20 if args.quick else 200))
    return [(recovery, job) for job in itertools.product(RACERS, _NOISES, indices)]


def recovery_tables(rows: list) -> list:
    """Returns how the drones recover, a row for each drone and noise."""
    columns = {
        "drone": "{drone}",
        "state noise": "{noise}",
        "hover within 3 s": "{recovered}/{count}",
        "worst (s)": "{worst_s:.2f}",
        "mean (s)": "{mean_s:.2f}",
        "worst height lost (m)": "{height_lost_m:.2f}",
        "yaw stopped, worst (s)": "{yaw_stopped_s:.2f}",
    }
    summary = []
    for (drone, noise), group in groups(rows, "drone", "noise"):
        times = harness.column(group, "hover_s")
        summary.append(
            {
                "drone": drone,
                "noise": noise,
                "recovered": np.sum(times <= 3.0),
                "count": len(group),
                "worst_s": times.max(),
                "mean_s": times.mean(),
                "height_lost_m": worst(group, "height_lost_m"),
                "yaw_stopped_s": worst(group, "yaw_stopped_s"),
            }
        )
    title = (
        f"Recovery from random attitudes and angular velocities of up to {MAX_RATE:g} rad/s\n"
        "(bounds: hover within 3 s, 12 m of height; the rotors need longer to stop the yaw)"
    )
    return [make_table(title, summary, columns)]


def tracking_jobs(args) -> list:
    """Returns the jobs that fly racing laps."""
    return [
        (tracking, (drone, case, noise, seed))
        for drone in RACERS
        for case in _TRACKING_CASES
        for noise in _NOISES
        for seed in range(1 if args.quick else case.seeds)
    ]


def tracking_tables(rows: list) -> list:
    """Returns how the drones track a lap, a row for each drone and case."""
    columns = {
        "drone": "{drone}",
        "case": "{case}",
        "RMS (m)": "{none_rms:.3f}",
        "x nominal": "{ratio:.1f}",
        "max (m)": "{none_max:.3f}",
        "noise: RMS (m)": "{nominal_rms:.3f}",
        "noise: max (m)": "{nominal_max:.3f}",
    }
    summary, nominal = [], np.nan
    for (drone, case), group in groups(rows, "drone", "case"):
        row = {"drone": drone, "case": case}
        for (noise,), part in groups(group, "noise"):
            row |= {f"{noise}_{key}": worst(part, f"{key}_m") for key in ("rms", "max")}
        if len(part) > 1:
            row["case"] += f" (worst of {len(part)})"
        nominal = row["none_rms"] if case == "nominal" else nominal
        summary.append(row | {"ratio": row["none_rms"] / nominal})
    title = (
        "Position error on the 3-D lap within 20 m/s and 10 m/s^2, "
        f"{racing_lap('Default').duration:.1f} s\n"
        "(bounds on the nominal RMS: 0.05 m, with noise 0.15 m; without feed-forward at "
        "least three times that)"
    )
    return [make_table(title, summary, columns)]


_RACE_COLUMNS = {
    "drone": "{drone}",
    "case": "{case}",
    "finished": "{finished}",
    "laps": "{flown}/{laps}",
    "collisions": "{collisions}",
    "worst gate offset (m)": "{worst_offset_m:.2f}",
    "why not": lambda row: row["dnf_reason"] or "",
}


def wind_jobs(args) -> list:
    """Returns the jobs that race in the wind."""
    return [(race, (drone, Case("wind", "Wind"), 1 if args.quick else 10)) for drone in RACERS]


def wind_tables(rows: list) -> list:
    """Returns how the drones race in the wind, a row for each."""
    title = "Races from pixels in the shipped scenario Wind (bound on the offset: 1 m)"
    return [make_table(title, rows, _RACE_COLUMNS | {"mean lap (s)": "{mean_lap_s:.2f}"})]


def loss_jobs(args) -> list:
    """Returns the jobs that lose rotors."""
    jobs = []
    for drone, drag in itertools.product(RACERS, _DRAGS):
        rotors = range(1, len(load_vehicle(drone)[0].rotors) + 1)
        phases = _PHASES if drone == "StarOne" else (None, *_PHASES)
        jobs += [(loss, (drone, (r,), phase, drag)) for phase in phases for r in rotors]
        if drone == "StarOne":
            pairs = itertools.combinations(rotors, 2)
            jobs += [(loss, (drone, pair, None, drag)) for pair in pairs]
    for time in _FAILURE_TIMES:
        text = f"rotor_failures: [{{rotor: {_FAILING_ROTOR}, time: {time}}}]"
        case = Case(f"rotor {_FAILING_ROTOR} fails at {time:.0f} s", "RotorFailure", text)
        jobs.append((race, ("StarOne", case, 1 if args.quick else 5)))
    return jobs


def loss_tables(rows: list) -> list:
    """Returns what becomes of drones that lose rotors, in four tables."""
    losses = [row for row in rows if "rotors" in row]
    in_lap = [row for row in losses if row["phase"] is not None and row["drone"] == "StarOne"]
    races = [row for row in rows if "laps" in row]
    means = {f"mean lap {when} (s)": f"{{mean_{when}_s:.2f}}" for when in ("before", "after")}
    return [
        _single_table(in_lap),
        _pair_table([row for row in losses if len(row["rotors"]) == 2]),
        _descent_table([row for row in losses if row["drone"] == "Default"]),
        make_table(
            "StarOne: races from pixels in which a rotor is lost", races, _RACE_COLUMNS | means
        ),
    ]


def _single_table(rows):
    summary = []
    for ((rotor,),), group in groups(rows, "rotors"):
        row = {"rotor": rotor, "found_after_ms": 1e3 * worst(group, "found_after_s")}
        for (drag,), part in groups(group, "drag"):
            row[_DRAGS[drag]] = worst(part, "deviation_m")
        summary.append(row)
    columns = {"rotor": "{rotor}", "found after (ms)": "{found_after_ms:.0f}"}
    for air in _DRAGS.values():
        columns[f"largest deviation (m), {air}"] = f"{{{air}:.3f}}"
    title = "StarOne: one rotor lost, at four phases of the lap (worst of them)"
    return make_table(title, summary, columns)


def _pair_table(rows):
    summary = []
    for (rotors,), group in groups(rows, "rotors"):
        row = {"rotors": " and ".join(map(str, rotors)), "can_fly": group[0]["can_fly"]}
        for each in group:
            air = _DRAGS[each["drag"]]
            row[f"{air}, deviation"] = each["deviation_m"]
            row[f"{air}, speed"] = float(np.hypot(each["sink_m_s"], each["side_m_s"]))
        summary.append(row)
    columns = {"rotors": "{rotors}", "controllable": "{can_fly}"}
    for air in _DRAGS.values():
        columns[f"largest deviation (m), {air}"] = f"{{{air}, deviation:.2f}}"
        columns[f"touch-down (m/s), {air}"] = f"{{{air}, speed:.2f}}"
    return make_table("StarOne: two rotors lost in a hover at 8 m", summary, columns)


def _descent_table(rows):
    columns = {
        "lost": "{lost}",
        "drag": "{drag}",
        "from (m)": "{height_m:.1f}",
        "takes (s)": "{descent_s:.1f}",
        "hit a pylon": "{hit}/{count}",
        "worst sink at touch-down (m/s)": "{sink_m_s:.2f}",
        "mean": "{mean_sink_m_s:.2f}",
        "worst to the side (m/s)": "{side_m_s:.2f}",
        "worst tilt (deg)": "{tilt_deg:.0f}",
        "fastest sink of all (m/s)": "{fastest_sink_m_s:.1f}",
    }
    summary = []
    for (phase, drag), group in groups(rows, "phase", "drag"):
        landed = [row for row in group if np.isfinite(row["sink_m_s"])]
        figures = ("descent_s", "sink_m_s", "side_m_s", "tilt_deg")
        summary.append(
            {
                "lost": "in a hover" if phase is None else f"at {phase:.0%} of the lap",
                "drag": bool(drag),
                "hit": len(group) - len(landed),
                "count": len(group),
                "mean_sink_m_s": np.mean(harness.column(landed, "sink_m_s")) if landed else None,
                **{key: worst(landed, key) for key in figures},
                **{key: worst(group, key) for key in ("height_m", "fastest_sink_m_s")},
            }
        )
    title = (
        "Default: each of the four rotors lost, the way down\n"
        "(touch-down: of those that did not hit a pylon on the way)"
    )
    return make_table(title, summary, columns)


SECTIONS = {
    "recovery": (recovery_jobs, recovery_tables),
    "tracking": (tracking_jobs, tracking_tables),
    "wind": (wind_jobs, wind_tables),
    "loss": (loss_jobs, loss_tables),
}


if __name__ == "__main__":
    sys.exit(main())
