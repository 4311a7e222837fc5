"""Races on an inertial sensor and pixels: how well the drone knows where it and the gates are.

    python -m benchmarks.estimation [--only student-airrace kinds generated ablations] [--seeds 4]
        [--laps 10] [--tracks 20] [--levels 1 3] [--preset racing] [--scenario_text YAML]
        [--workers N] [--json FILE]

`student-airrace`: that track with the estimator `vio`, beside the same races with `truth`,
a race a seed. `kinds`: that track in other laps and with the other drone. `generated`: one lap
on random tracks that obey the rules, a race a track, at each level of difficulty. `ablations`:
the track student-airrace with something left out or wrong. The results do not depend on the number
of workers.

Errors are those of the estimate as it is, without any alignment. NEES is the normalised
estimation error squared of attitude, position and velocity, a dimension: 1 if the covariance
is right.
"""

import dataclasses as dc
import itertools
import math
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from unittest import mock

import numpy as np
from pydrake.systems.framework import System

from airrace.scenario import TRUTH, VIO, Scenario, load_scenario
from airrace.scenario.imu_config import PRESETS
from airrace.systems.estimation import slam_filter
from airrace.systems.estimation.error_state import AT
from airrace.systems.exploring.explorer import Explorer
from benchmarks import harness, races
from benchmarks.harness import groups
from benchmarks.races import Case
from tests.worlds.estimation_log import fly_logged

_COLUMNS = {
    "": "{name}",
    "finished": "{finished} of {races}",
    "mean lap (s)": "{mean_lap_s:.2f}",
    "to truth's": "{to_truth:+.2%}",
    "position RMS exploring (cm)": "{position_rms_exploring_cm:.1f}",
    "racing": "{position_rms_racing_cm:.1f}",
    "map RMS explored (cm)": "{map_rms_explored_cm:.1f}",
    "at the end": "{map_rms_end_cm:.1f}",
    "neighbours explored": "{neighbours_rms_explored_cm:.1f}",
    "at the  end": "{neighbours_rms_end_cm:.1f}",
    "gate offsets, RMS (cm)": "{gate_offset_rms_cm:.1f}",
    "worst": "{worst_gate_offset_cm:.1f}",
    "why not": "{reasons}",
}
_CONSISTENCY = {
    "": "{name}",
    "NEES exploring": "{nees_exploring:.2f}",
    "NEES racing": "{nees_racing:.2f}",
    "gap exploring (s)": "{longest_gap_exploring_s:.1f}",
    "gap racing": "{longest_gap_racing_s:.1f}",
}
_MEANS = ("nees_exploring", "nees_racing")
_LENGTHS = [
    f"{what}_rms_{when}"
    for what, moments in (
        ("position", ("exploring", "racing")),
        ("map", ("explored", "end")),
        ("neighbours", ("explored", "end")),
    )
    for when in moments
]
_GAPS = ("longest_gap_exploring_s", "longest_gap_racing_s")


def main(argv=None) -> int:
    """Flies the races and prints the tables; exit code 1 if one did not finish."""
    parser = harness.make_parser(__doc__)
    parser.add_argument(
        "--only", nargs="+", choices=_MAKERS, default=list(_MAKERS), help="(default: all)"
    )
    parser.add_argument(
        "--seeds", type=harness.count, default=4, help="on the track student-airrace (default: 4)"
    )
    parser.add_argument(
        "--laps", type=harness.count, default=10, help="on the track student-airrace (default: 10)"
    )
    parser.add_argument(
        "--tracks", type=harness.count, default=20, help="generated, a level (default: 20)"
    )
    parser.add_argument(
        "--levels", nargs="+", choices=list("01234"), default=["1", "3"], help="(default: 1 3)"
    )
    parser.add_argument("--preset", choices=PRESETS, help="of the IMU (default: the scenario's)")
    parser.add_argument(
        "--scenario_text", metavar="YAML", help="scenario fields on top, e.g. '{drone: StarOne}'"
    )
    parser.add_argument("--workers", type=harness.count, default=1, help="processes (default: 1)")
    return harness.run(parser, argv, measure, show)


def measure(args) -> dict:
    """Returns rows of fly(), with the ``name`` of their case, by the name of the table."""
    return {name: races.fly_all(_MAKERS[name](args), args.workers) for name in args.only}


def _estimating(scenario: Scenario, args) -> Scenario:
    """Returns a scenario with the estimator ``vio`` and the IMU of the options."""
    imu = scenario.imu if args.preset is None else dc.replace(scenario.imu, preset=args.preset)
    return dc.replace(scenario, estimator=VIO, imu=imu)


def _race(args) -> Scenario:
    """Returns the scenario of the options on the track student-airrace."""
    scenario = load_scenario(scenario_text=args.scenario_text)
    return dc.replace(_estimating(scenario, args), laps=args.laps)


def _student_airrace(args) -> list[Case]:
    scenario = _race(args)
    return [
        Case(name, dc.replace(scenario, estimator=name), range(args.seeds), fly=fly)
        for name in (VIO, TRUTH)
    ]


def _kinds(args) -> list[Case]:
    scenario = _race(args)
    rotor = dc.replace(scenario.planner, limits="rotor")
    kinds = {
        "3-D": dc.replace(scenario, trajectory="3"),
        "optimal, rotor": dc.replace(scenario, planner=rotor),
        "optimal, StarOne": dc.replace(scenario, drone="StarOne"),
    }
    return [Case(name, each, range(args.seeds), fly=fly) for name, each in kinds.items()]


def _generated(args) -> list[Case]:
    return [
        Case(
            f"level {level}",
            _estimating(races.lap_of_level(level, args), args),
            range(args.tracks),
            True,
            fly,
        )
        for level in args.levels
    ]


def _ablations(args) -> list[Case]:
    scenario = _race(args)

    def with_imu(**fields):
        return dc.replace(scenario, imu=dc.replace(scenario.imu, **fields))

    def with_clock_ahead(offset):
        return with_imu(errors=dc.replace(scenario.imu.errors, time_offset=offset))

    hasty = scenario.systems | {"explorer": "benchmarks.estimation:make_hasty_explorer"}
    cases = {
        "complete": (scenario, fly),
        "no loop closure": (dc.replace(scenario, systems=hasty), fly),
        "no robust weights": (scenario, fly_without_robust_weights),
        "no bias of the gyroscope": (scenario, fly_without_gyro_bias),
        "IMU at 100 Hz": (with_imu(rate=100.0), fly),
        "IMU's clock 1 ms ahead": (with_clock_ahead(0.001), fly),
        "5 ms": (with_clock_ahead(0.005), fly),
        "20 ms": (with_clock_ahead(0.020), fly),
    }
    seeds = range(args.seeds)
    return [Case(name, each, seeds, fly=how) for name, (each, how) in cases.items()]


_MAKERS = {
    "student-airrace": _student_airrace,
    "kinds": _kinds,
    "generated": _generated,
    "ablations": _ablations,
}


def fly(scenario_text: str, track_seed: int | None = None) -> dict:
    """Flies a race; returns its figures, see benchmarks.races.fly(), and its estimator's."""
    with tempfile.TemporaryDirectory() as folder:
        scenario = races.scenario_of(scenario_text, track_seed, Path(folder))
        race, figures = fly_logged(scenario, Path(folder))
    return {**races.figures(scenario, race), "estimator": scenario.estimator, **figures}


def make_hasty_explorer(scenario: Scenario) -> System:
    """Returns an explorer that goes home when it sees gate 1 again, without closing the loop."""
    explorer = Explorer.from_scenario(scenario, drifts=True)
    explorer._machine._closes_loop = False
    return explorer


def fly_without_robust_weights(*race) -> dict:
    """As fly(), but every marker counts, and as much as its covariance says."""
    with mock.patch.multiple(slam_filter, _DOUBTFUL=math.inf, REFUSED=math.inf):
        return fly(*race)


def fly_without_gyro_bias(*race) -> dict:
    """As fly(), but the gyroscope is believed to have no bias."""
    align, propagate = slam_filter.aligned, slam_filter.propagate

    def aligned(*arguments):
        quaternion, gyro_bias, accel_bias, P = align(*arguments)
        P = P.copy()
        P[AT.gyro_bias] = P[:, AT.gyro_bias] = 0.0
        return quaternion, np.zeros_like(gyro_bias), accel_bias, P

    def propagated(*arguments):
        *others, noise = arguments
        return propagate(*others, noise._replace(gyro_walk=0.0))

    with mock.patch.multiple(slam_filter, aligned=aligned, propagate=propagated):
        return fly(*race)


def summary(name: str, rows: list[dict]) -> dict:
    """Returns the figures of a row of a table: means over races, of errors their RMS.

    Args:
        name: of the row.
        rows: of fly().
    """
    result = races.summary(name, rows)
    offsets = np.array([o for row in rows for lap in row["gate_offsets_m"] for o in lap], float)
    result["gate_offset_rms_cm"] = 100.0 * np.sqrt(np.mean(offsets**2)) if len(offsets) else None
    result["worst_gate_offset_cm"] = 100.0 * offsets.max() if len(offsets) else None
    for key in _MEANS:
        result[key] = _of(rows, key, np.mean)
    for key in _LENGTHS:
        result[f"{key}_cm"] = 100.0 * _of(
            rows, f"{key}_m", lambda values: np.sqrt(np.mean(np.square(values)))
        )
    for key in _GAPS:
        result[key] = _of(rows, key, np.max)
    return result


def _of(rows: list[dict], key: str, function: Callable[[np.ndarray], float]) -> float:
    """Returns a function of the values that there are, NaN if there are none."""
    values = np.array([row[key] for row in rows], float)
    values = values[np.isfinite(values)]
    return float(function(values)) if len(values) else math.nan


def summaries(rows: list[dict]) -> list[dict]:
    """Returns a summary() of every case; beside truth, how much slower the laps are."""
    result = [summary(name, each) for (name,), each in groups(rows, "name")]
    truths = [each["mean_lap_s"] for each in result if each["name"] == TRUTH]
    for each in result:
        both = truths and truths[0] and each["mean_lap_s"] and each["name"] != TRUTH
        each["to_truth"] = each["mean_lap_s"] / truths[0] - 1.0 if both else None
    return result


def show(results: dict) -> tuple[list, bool]:
    """Returns the tables of what measure() found, and whether all races finished."""
    titles = {
        "student-airrace": "The track student-airrace",
        "kinds": "The track student-airrace, in other laps and with the other drone",
        "generated": "One lap on generated tracks, a race a track",
        "ablations": "The track student-airrace, with something left out or wrong",
    }
    tables = []
    for name, rows in results.items():
        columns = {
            k: v for k, v in _COLUMNS.items() if k != "to truth's" or name == "student-airrace"
        }
        tables.append(harness.make_table(titles[name], summaries(rows), columns))
        title = f"{titles[name]}: consistency, and the longest time without a marker"
        tables.append(harness.make_table(title, summaries(rows), _CONSISTENCY))
    finished = all(row["finished"] for row in itertools.chain(*results.values()))
    return tables, finished


if __name__ == "__main__":
    sys.exit(main())
