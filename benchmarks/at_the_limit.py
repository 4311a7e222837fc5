"""Laps at the limit of the rotors, and what each part buys that knows better or waits.

    python -m benchmarks.at_the_limit [--levels 1 2 3] [--runs 3] [--laps 5] [--pixels]
                                      [--speed-runs 3] [--share SHARE] [--workers N] [--json FILE]

Races of the track student-airrace with `--limits rotor`, on the true map and without pictures
unless --pixels asks for them: with all parts, with each alone taken away, and with none. A lap
counts from the third on, when what can be learnt is known. A race that does not finish is a result,
too. Of the error of the position, the part that is the same in every lap is what one lap could
teach the next.

What the parts cost is measured in races of their own, of one lap from pixels at level 1, with all
parts and with none in turn. There every lap is planned anew whatever the parts do. A speed is the
median of ratios to the race with all parts of the same turn, by the processor's time from take-off
on.
"""

import argparse
import dataclasses as dc
import sys
import tempfile
from pathlib import Path

import numpy as np
from pydrake.common.yaml import yaml_dump_typed

from airrace.analysis import load_run
from airrace.common.errors import UserError
from airrace.common.resources import load_yaml
from airrace.scenario import Scenario, load_scenario
from airrace.systems.control.geometric_controller import GeometricController
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.planning.lap_planner import LapPlanner
from airrace.systems.planning.path_clock import REGULAR_VECTOR
from airrace.vehicle import load_vehicle
from airrace.vehicle.air import STILL_VECTOR
from benchmarks import harness
from benchmarks.harness import column, groups
from benchmarks.race_speed import EXPLORATION, LAPS, fly
from benchmarks.races import Case, figures, fly_all, summary
from benchmarks.whole_race import fly_race

_FIRST = 2  # laps that do not count
_SAMPLES = 400  # of a lap
_ALL, _NONE = "all parts", "without any"
# What takes the place of a part, as a system of one's own.
_PARTS = {
    "without the moment observer": {"moment_observer": "no_moment"},
    "without learning the rotors": {"rotor_learner": "rotors_as_in_the_file"},
    "without learning the air": {"air_learner": "still_air"},
    "without the governor": {"path_governor": "clock_that_never_waits"},
    "without margins by tracking": {"lap_planner": "planner_that_notes_no_errors"},
}
# Likewise of the controller; they are there in races without any of the parts above, too.
_CONTROL = {
    "without feed-forward of rates": {"geometric_controller": "no_feed_forward"},
    "without overdriven rotors": {"geometric_controller": "no_overdrive"},
    "thrusts cut off at limits": {"geometric_controller": "cut_off"},
}
_COLUMNS = {
    "level": "{level}",
    "": "{what}",
    "finished": "{finished} of {races}",
    "lap from the third on (s)": "{settled_s:.2f}",
    "flown less planned (ms)": "{late_ms:.0f}",
    "error, RMS (cm)": "{error_cm:.1f}",
    "the same every lap (cm)": "{repeats_cm:.1f}",
    "touched": "{touched}",
    "why not": "{reasons}",
}
_SPEED_COLUMNS = {
    "": "{what}",
    "x real time, CPU": "{speed:.2f}",
    "by that with all parts": "{ratio:.3f}",
    "least": "{least:.3f}",
    "most": "{most:.3f}",
}


class _SameMargins(LapPlanner):
    def _note_error(self, context, discrete_state):
        pass


def planner_that_notes_no_errors(scenario: Scenario) -> LapPlanner:
    """Takes the place of LapPlanner."""
    return _SameMargins.from_scenario(scenario)


class _Constant(LeafSystem):
    """A system with one output, which never changes."""

    def __init__(self, port: str, value: np.ndarray):
        LeafSystem.__init__(self)
        self.DeclareStateOutputPort(port, self.DeclareDiscreteState(value))


def no_feed_forward(scenario: Scenario) -> GeometricController:
    """Takes the place of GeometricController: rates and angular accelerations are not led."""
    return _controller(scenario, feed_forward=False)


def no_overdrive(scenario: Scenario) -> GeometricController:
    """Takes the place of GeometricController: commanded speeds are the desired ones."""
    return _controller(scenario, rotor_overdrive=False)


def _controller(scenario: Scenario, **changes) -> GeometricController:
    config = dc.replace(scenario.controller, **changes)
    return GeometricController.from_scenario(dc.replace(scenario, controller=config))


class _CutOff(GeometricController):
    """Gives up nothing in order: each thrust of the pseudo-inverse ends at its rotor's limit."""

    def __init__(self, **options):
        GeometricController.__init__(self, **options)
        known = self._known

        def cut_off(losses, factors):
            remaining, *others = known(losses, factors)
            inverse, most = remaining.allocator.inverse, remaining.max_thrusts
            remaining.allocator.allocate = lambda wrench: np.clip(inverse @ wrench, 0.0, most)
            return remaining, *others

        self._known = cut_off


def cut_off(scenario: Scenario) -> GeometricController:
    """Takes the place of GeometricController."""
    return _CutOff.from_scenario(scenario)


def no_moment(scenario: Scenario) -> _Constant:
    """Takes the place of MomentObserver."""
    return _Constant("disturbance_moment", np.zeros(3))


def rotors_as_in_the_file(scenario: Scenario) -> _Constant:
    """Takes the place of RotorLearner."""
    return _Constant("rotor_factors", np.ones(len(load_vehicle(scenario.drone)[0].rotors)))


def still_air(scenario: Scenario) -> _Constant:
    """Takes the place of AirLearner."""
    return _Constant("air", STILL_VECTOR)


def clock_that_never_waits(scenario: Scenario) -> _Constant:
    """Takes the place of PathGovernor."""
    return _Constant("path_clock", REGULAR_VECTOR)


def main(argv=None) -> int:
    """Flies the races and prints the table."""
    parser = harness.make_parser(__doc__, runs=3)
    parser.add_argument("--levels", nargs="+", choices=list("01234"), default=list("123"))
    parser.add_argument("--laps", type=harness.count, default=5, help="(default: 5)")
    parser.add_argument("--share", type=float, default=1.0, help="planner.thrust_share")
    parser.add_argument("--pixels", action="store_true", help="explore and map from pictures")
    parser.add_argument(
        "--speed-runs", type=harness.count, default=3, help="races for the speed (default: 3)"
    )
    parser.add_argument("--only", nargs="+", help="parts, by how their names end (default: all)")
    parser.add_argument("--workers", type=harness.count, default=1, help="processes (default: 1)")
    return harness.run(parser, argv, measure, show)


def measure(args) -> dict:
    """Returns ``laps``, rows of fly_all() whose ``name`` is a level and what was taken away.

    And ``speed``: with all parts, and with none, the speeds of races, by CPU time.
    """
    none = {k: v for p in _PARTS.values() for k, v in p.items()}
    kinds = {_ALL: {}, **_PARTS, **_CONTROL, _NONE: none}
    wanted = {k: v for k, v in kinds.items() if not args.only or k.endswith(tuple(args.only))}
    if not wanted:
        raise UserError(f"No part's name ends like that; there are {', '.join(kinds)}.")
    cases = [
        Case(
            f"{level}: {name}", _scenario(args, level, systems), range(args.runs), fly=_fly_tracked
        )
        for level in args.levels
        for name, systems in wanted.items()
    ]
    laps = fly_all(cases, args.workers)
    short = argparse.Namespace(laps=1, share=args.share, pixels=True)
    ends = [name for name in (_ALL, _NONE) if name in wanted]
    texts = [yaml_dump_typed(_scenario(short, "1", kinds[k]), schema=Scenario) for k in ends]
    jobs = [(_speed, (text,)) for text in texts]
    # One at a time, each in a process of its own.
    turns = args.speed_runs * jobs
    speeds = harness.in_processes(turns, "Taking the time")
    return {"laps": laps, "speed": {k: speeds[i :: len(jobs)] for i, k in enumerate(ends)}}


def _fly_tracked(scenario_text: str, _track_seed: None = None) -> dict:
    """Flies a race; returns its figures(), and ``late_s``, ``error_m``, ``repeats_m``, as RMS."""
    scenario = load_scenario(scenario_text=scenario_text)
    logged = dc.replace(scenario, recording=dc.replace(scenario.recording, content="light"))
    with tempfile.TemporaryDirectory() as folder:
        race = fly_race(logged, Path(folder))
        samples = load_run(folder).tracking[["time", "x", "y", "z"]].to_numpy()
    laps = [lap for lap in race["laps"][_FIRST:] if lap["plan"]]
    late = [lap["time_s"] - lap["plan"]["duration_s"] for lap in laps]
    return {
        **figures(scenario, race),
        "late_s": float(np.mean(late)) if laps else None,
        **(_errors(samples, laps) if len(laps) > 1 else {}),
    }


def _errors(samples: np.ndarray, laps: list[dict]) -> dict:
    """Returns how far the drone was off its reference, and the part that all laps share, as RMS.

    Args: samples: time and error, (N, 4). laps: two or more of race.json.
    """
    time, *error = samples.T
    share = np.linspace(0.0, 1.0, _SAMPLES, endpoint=False)
    places = [lap["start_s"] + share * lap["time_s"] for lap in laps]
    each = np.array([[np.interp(t, time, e) for e in error] for t in places])  # laps, 3, samples
    # The mean of n laps still has an nth of the power that differs from lap to lap.
    shared = np.sum(each.mean(axis=0) ** 2 - each.var(axis=0, ddof=1) / len(each), axis=0).mean()
    return {
        "error_m": float(np.sqrt(np.sum(each**2, axis=1).mean())),
        "repeats_m": float(np.sqrt(max(shared, 0.0))),
    }


def _speed(scenario_text: str) -> float:
    """Returns the simulated time of a race by the CPU time, from take-off on."""
    phases = fly(scenario_text)["phases"]
    times = [phases[name] for name in (EXPLORATION, LAPS) if name in phases]
    return sum(column(times, "simulated_s")) / sum(column(times, "cpu_s"))


def _scenario(args, level: str, systems: dict[str, str]) -> Scenario:
    scenario = load_scenario(filename="levels", scenario_name=f"Level{level}")
    text = f"{{laps: {args.laps}, planner: {{limits: rotor, thrust_share: {args.share}}}}}"
    scenario = load_yaml(Scenario, data=text, defaults=scenario)
    if not args.pixels:
        scenario.map, scenario.camera.renderer = "track", "none"
    return dc.replace(
        scenario, systems={k: f"benchmarks.at_the_limit:{v}" for k, v in systems.items()}
    )


def show(results: dict) -> tuple[list, bool]:
    """Returns the tables of what measure() found."""
    laps = [_row(group) for group in groups(results["laps"], "name")]
    tables = [harness.make_table("Laps at the limit", laps, _COLUMNS)]
    if results["speed"].get(_ALL):
        rows = _speed_rows(results["speed"])
        tables.append(harness.make_table("What the parts cost", rows, _SPEED_COLUMNS))
    return tables, True


def _speed_rows(speeds: dict) -> list[dict]:
    reference = np.array(speeds[_ALL])
    return [
        {
            "what": what,
            "speed": float(np.median(each)),
            "ratio": float(np.median(each / reference)),
            "least": float(np.min(each / reference)),
            "most": float(np.max(each / reference)),
        }
        for what, each in speeds.items()
    ]


def _row(group: tuple) -> dict:
    (name,), rows = group
    level, what = name.split(": ", 1)
    settled = [time for row in rows for time in row["lap_times_s"][_FIRST:]]

    def mean(key, unit):
        found = [row[key] for row in rows if row.get(key) is not None]
        return unit * float(np.mean(found)) if found else None

    own = {
        "level": level,
        "late_ms": mean("late_s", 1e3),
        "error_cm": mean("error_m", 1e2),
        "repeats_cm": mean("repeats_m", 1e2),
        "what": what,
        "settled_s": float(np.mean(settled)) if settled else None,
        "touched": int(column(rows, "collisions").sum()),
    }
    return {**summary(name, rows), **own}


if __name__ == "__main__":
    sys.exit(main())
