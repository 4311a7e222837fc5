"""What a longer track costs: races of 10 and of 20 gates, per simulated second.

    python -m benchmarks.growth [--runs 5] [--laps 1] [--json FILE]

Each run flies a generated track of either length from pixels, one after the other,
so that other work of the machine slows down both.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from pydrake.common.yaml import yaml_dump_typed

from airrace.diagrams.warm_up import compile_apart
from airrace.evaluation.jobs import generated_track
from airrace.scenario import Scenario, load_scenario
from benchmarks import harness, race_speed

_GATES = 10, 20
_TITLE = "Races of either length, medians (the longer to cost at most 1.3 times the shorter)"
_FIRST_SEED = 1000


def main(argv=None) -> int:
    """Flies the races and prints the table; exit code 1 if one did not finish."""
    parser = harness.make_parser(__doc__, runs=5)
    parser.add_argument("--laps", type=harness.count, default=1, help="of a race (default: 1)")
    parser.add_argument(
        "--scenario_text", metavar="YAML", help="scenario fields on top of the default"
    )
    return harness.run(parser, argv, measure, show)


def measure(args) -> list:
    """Returns a row for every race."""
    seeds = range(_FIRST_SEED, _FIRST_SEED + args.runs)
    jobs = [
        (fly, (seed, gates, args.laps, args.scenario_text)) for seed in seeds for gates in _GATES
    ]
    compile_apart(load_scenario(scenario_text=args.scenario_text))
    return harness.in_processes(jobs, "Racing")


def fly(seed: int, gates: int, laps: int, scenario_text: str | None) -> dict:
    """Returns what a race on the generated track of a seed takes, in wall and CPU seconds."""
    with tempfile.TemporaryDirectory() as folder:
        track = Path(folder, "track.yaml")
        track.write_text(generated_track(seed, gates)[1])
        scenario = load_scenario(scenario_text=scenario_text)
        scenario.track, scenario.laps, scenario.seed = str(track), laps, seed
        scenario.recording.content = "none"
        result = race_speed.fly(yaml_dump_typed(scenario, schema=Scenario))
    phases = [phase for name, phase in result["phases"].items() if name != race_speed.SET_UP]
    times = {key: sum(phase[key] for phase in phases) for key in race_speed.TIMES}
    return {"seed": seed, "gates": gates, "finished": result["race"]["finished"], **times}


def show(rows: list) -> tuple[list, bool]:
    """Returns the table of the rows, and whether all races finished."""
    summary, costs = [], {}
    for (gates,), group in harness.groups(rows, "gates"):
        simulated = harness.column(group, "simulated_s")
        costs[gates] = harness.column(group, "cpu_s") / simulated
        summary.append(
            {
                "gates": gates,
                "finished": sum(row["finished"] for row in group),
                "races": len(group),
                "simulated_s": np.median(simulated),
                "speed": 1.0 / np.median(costs[gates]),
                "ratio": np.median(costs[gates] / costs[_GATES[0]]),
            }
        )
    columns = {
        "gates": "{gates}",
        "finished": "{finished} of {races}",
        "simulated (s)": "{simulated_s:.0f}",
        "x real time": "{speed:.2f}",
        f"beside {_GATES[0]} gates": "{ratio:.2f}",
    }
    table = harness.make_table(_TITLE, summary, columns)
    return [table], all(row["finished"] for row in rows)


if __name__ == "__main__":
    sys.exit(main())
