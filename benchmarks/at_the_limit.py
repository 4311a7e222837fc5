"""Laps at the limit of the rotors, and what each part buys that knows better or waits.

    python -m benchmarks.at_the_limit [--levels 1 2 3] [--runs 3] [--laps 5] [--pixels]
                                      [--share SHARE] [--workers N] [--json FILE]

Races of the track student-airrace with `--limits rotor`, on the true map and without pictures
unless --pixels asks for them: with all parts, with each alone taken away, and with none. A lap
counts from the third on, when what can be learnt is known. A race that does not finish is a result,
too.
"""

import dataclasses as dc
import sys

import numpy as np

from airrace.common.resources import load_yaml
from airrace.scenario import Scenario, load_scenario
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.planning.path_clock import REGULAR, clock_vector
from airrace.vehicle import load_vehicle
from airrace.vehicle.air import STILL, air_vector
from benchmarks import harness
from benchmarks.harness import groups
from benchmarks.races import Case, fly_all, summary

_FIRST = 2  # laps that do not count
_ALL = "all parts"
# What takes the place of a part, as a system of one's own.
_PARTS = {
    "without the moment observer": {"moment_observer": "no_moment"},
    "without learning the rotors": {"rotor_learner": "rotors_as_in_the_file"},
    "without learning the air": {"air_learner": "still_air"},
    "without the governor": {"path_governor": "clock_that_never_waits"},
}
_COLUMNS = {
    "level": "{level}",
    "": "{what}",
    "finished": "{finished} of {races}",
    "lap from the third on (s)": "{settled_s:.2f}",
    "best lap (s)": "{best_lap_s:.2f}",
    "why not": "{reasons}",
}


class _Constant(LeafSystem):
    """A system with one output, which never changes."""

    def __init__(self, port: str, value: np.ndarray):
        LeafSystem.__init__(self)
        self.DeclareStateOutputPort(port, self.DeclareDiscreteState(value))


def no_moment(scenario: Scenario) -> _Constant:
    """Takes the place of MomentObserver."""
    return _Constant("disturbance_moment", np.zeros(3))


def rotors_as_in_the_file(scenario: Scenario) -> _Constant:
    """Takes the place of RotorLearner."""
    return _Constant("rotor_factors", np.ones(len(load_vehicle(scenario.drone)[0].rotors)))


def still_air(scenario: Scenario) -> _Constant:
    """Takes the place of AirLearner."""
    return _Constant("air", air_vector(STILL))


def clock_that_never_waits(scenario: Scenario) -> _Constant:
    """Takes the place of PathGovernor."""
    return _Constant("path_clock", clock_vector(REGULAR))


def main(argv=None) -> int:
    """Flies the races and prints the table."""
    parser = harness.make_parser(__doc__, runs=3)
    parser.add_argument("--levels", nargs="+", choices=list("01234"), default=list("123"))
    parser.add_argument("--laps", type=harness.count, default=5, help="(default: 5)")
    parser.add_argument("--share", type=float, default=1.0, help="planner.thrust_share")
    parser.add_argument("--pixels", action="store_true", help="explore and map from pictures")
    parser.add_argument("--only", nargs="+", help="parts, by how their names end (default: all)")
    parser.add_argument("--workers", type=harness.count, default=1, help="processes (default: 1)")
    return harness.run(parser, argv, measure, show)


def measure(args) -> list[dict]:
    """Returns rows of fly_all(); ``name`` is a level and what was taken away."""
    kinds = {
        _ALL: {},
        **_PARTS,
        "without any": {k: v for p in _PARTS.values() for k, v in p.items()},
    }
    wanted = [name for name in kinds if not args.only or name.endswith(tuple(args.only))]
    cases = [
        Case(f"{level}: {name}", _scenario(args, level, kinds[name]), range(args.runs))
        for level in args.levels
        for name in wanted
    ]
    return fly_all(cases, args.workers)


def _scenario(args, level: str, systems: dict[str, str]) -> Scenario:
    scenario = load_scenario(filename="levels", scenario_name=f"Level{level}")
    text = f"{{laps: {args.laps}, planner: {{limits: rotor, thrust_share: {args.share}}}}}"
    scenario = load_yaml(Scenario, data=text, defaults=scenario)
    if not args.pixels:
        scenario.map, scenario.camera.renderer = "track", "none"
    return dc.replace(
        scenario, systems={k: f"benchmarks.at_the_limit:{v}" for k, v in systems.items()}
    )


def show(rows: list[dict]) -> tuple[list, bool]:
    """Returns the table of what measure() found."""
    return [
        harness.make_table("Laps at the limit", [*map(_row, groups(rows, "name"))], _COLUMNS)
    ], True


def _row(group: tuple) -> dict:
    (name,), rows = group
    level, what = name.split(": ", 1)
    settled = [time for row in rows for time in row["lap_times_s"][_FIRST:]]
    mean = float(np.mean(settled)) if settled else None
    return {**summary(name, rows), "level": level, "what": what, "settled_s": mean}


if __name__ == "__main__":
    sys.exit(main())
