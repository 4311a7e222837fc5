"""The original system's races beside ours, and what each of our improvements makes of them.

    python -m benchmarks.original [--only original improved] [--runs 1] [--laps 10]
                                  [--workers N] [--json FILE]

`original`: Student AirRace, as its paper gives its laps, and the scenario file `original`,
which flies that system here. `improved`: the same 3-D laps with one improvement switched on at
a time, and then with all: what airrace flies by default. All races are of the track student-airrace
and from pixels, each of a seed of its own. A race that does not finish is a result, too.
"""

import dataclasses as dc
import sys

from airrace.common.resources import load_yaml
from airrace.scenario import Scenario, load_scenario
from benchmarks import harness
from benchmarks.races import Case, fly_all, summaries

_NAMES = {"3": "ThreeD", "4": "FourD", "6": "SixD"}
# What is switched on, as YAML on top of the original with 3-D laps.
_IMPROVEMENTS = {
    "none: the original's system": "{}",
    "quickest times": "{planner: {time_allocation: exact}}",
    "quickest times, no stop at gate 1": "{planner: {time_allocation: exact, lap: periodic}}",
    "time-optimal laps": "{trajectory: optimal, planner: {time_allocation: exact, lap: periodic}}",
    "our controller, with feed-forward": """{
        controller: {feed_forward: true, disturbance_rejection: true, attitude_error: reduced,
                     gains: vehicle, rotor_overdrive: true, rate: 500},
        state_filter: {enabled: true}, planner: {waits: true}}""",
    "corners refitted, gates as one body": "{perception: {corners: refit, poses: gate}}",
    "robust map": """{perception: {map_estimator: robust, jump_filter: true, max_range: 30,
                                   min_observations: 5}}""",
    "explorer without stops": """{explorer: {
        max_speed: 8, max_acceleration: 6, reached_distance: 1, hover_time: 0.5, step_length: 15,
        hover_before_step: false, expected_gates: null}}""",
}
_ALL = "all together: airrace's defaults"
_COLUMNS = {
    "": "{name}",
    "finished": "{finished} of {races}",
    "mean lap (s)": "{mean_lap_s:.2f}",
    "worst gate offset (m)": "{worst_gate_offset_m:.2f}",
    "map, RMS error (cm)": "{map_rms_cm:.1f}",
    "exploration (s)": "{exploration_s}",
    "why not": "{reasons}",
}


def main(argv=None) -> int:
    """Flies the races and prints the tables."""
    parser = harness.make_parser(__doc__, runs=1)
    parser.add_argument(
        "--only", nargs="+", choices=_MAKERS, default=list(_MAKERS), help="(default: both)"
    )
    parser.add_argument("--laps", type=harness.count, default=10, help="(default: 10)")
    parser.add_argument(
        "--scenario_text",
        metavar="YAML",
        help="scenario fields on top, e.g. '{camera: {preset: harsh}}'",
    )
    parser.add_argument("--workers", type=harness.count, default=1, help="processes (default: 1)")
    return harness.run(parser, argv, measure, show)


def measure(args) -> dict:
    """Returns rows of fly_all() by the name of the table."""
    return {name: fly_all(_MAKERS[name](args), args.workers) for name in args.only}


def _original(args) -> list[Case]:
    return [_case(args, f"{d}-D", load(name)) for d, name in _NAMES.items()]


def _improved(args) -> list[Case]:
    cases = [_case(args, name, load("ThreeD", text)) for name, text in _IMPROVEMENTS.items()]
    camera = load("ThreeD").camera
    return [*cases, _case(args, _ALL, dc.replace(Scenario(), camera=camera))]


_MAKERS = {"original": _original, "improved": _improved}


def load(name: str, text: str | None = None) -> Scenario:
    """Returns a scenario of the file `original`, with fields on top as YAML."""
    return load_scenario(filename="original", scenario_name=name, scenario_text=text)


def _case(args, name: str, scenario: Scenario) -> Case:
    if args.scenario_text:
        scenario = load_yaml(Scenario, data=args.scenario_text, defaults=scenario)
    return Case(name, dc.replace(scenario, laps=args.laps), range(args.runs))


def show(results: dict) -> tuple[list, bool]:
    """Returns the tables of what measure() found."""
    tables = []
    for name, rows in results.items():
        columns, title = dict(_COLUMNS), "One improvement switched on at a time"
        if name == "original":
            columns["Student AirRace, mean lap (s)"] = "{original_s:.2f}"
            title = "The scenario file `original`, and the laps of the original system"
        tables.append(harness.make_table(title, summaries(rows), columns))
    return tables, True


if __name__ == "__main__":
    sys.exit(main())
