"""Whole races from pixels, side by side: lap times, how near the gates, and how good the map.

    python -m benchmarks.races [--only student-airrace generated] [--runs 4] [--laps 10]
        [--tracks 20] [--levels 1 3 4] [--scenario_text YAML] [--workers N] [--json FILE]

`student-airrace`: that track in all kinds of laps, beside the mean laps of the original
system there, which flew from rest to rest. Every row is so many races (--runs), each of a
seed of its own. `generated`: one lap on random tracks that obey the rules, at each level of
difficulty, a race a track (--tracks). The results do not depend on the number of workers.
"""

import dataclasses as dc
import itertools
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydrake.common.yaml import yaml_dump_typed

from airrace.diagrams.warm_up import compile_apart
from airrace.evaluation.jobs import generated_track
from airrace.evaluation.summary import dnf_class
from airrace.recording.race_result import ORIGINAL_LAPS
from airrace.scenario import Scenario, load_scenario
from benchmarks import harness
from benchmarks.harness import column, groups
from benchmarks.whole_race import fly_race

_COLUMNS = {
    "": "{name}",
    "finished": "{finished} of {races}",
    "mean lap (s)": "{mean_lap_s:.2f}",
    "best lap (s)": "{best_lap_s:.2f}",
    "worst gate offset (m)": "{worst_gate_offset_m:.2f}",
    "map, RMS error (cm)": "{map_rms_cm:.2f}",
    "exploration (s)": "{exploration_s}",
    "why not": "{reasons}",
}


class Case(NamedTuple):
    """Races that make one row of a table.

    Attributes:
        name: of the row.
        scenario: of all its races, but for the seed and, if they are generated, the tracks.
        seeds: one a race.
        generated: whether the tracks are generated, each from its race's seed.
        fly: takes the place of fly().
    """

    name: str
    scenario: Scenario
    seeds: Sequence[int]
    generated: bool = False
    fly: Callable[..., dict] | None = None


def main(argv=None) -> int:
    """Flies the races and prints the tables; exit code 1 if one did not finish."""
    parser = harness.make_parser(__doc__, runs=4)
    parser.add_argument(
        "--only", nargs="+", choices=_MAKERS, default=list(_MAKERS), help="(default: both)"
    )
    parser.add_argument(
        "--laps", type=harness.count, default=10, help="on the track student-airrace (default: 10)"
    )
    parser.add_argument(
        "--tracks", type=harness.count, default=20, help="generated, a level (default: 20)"
    )
    parser.add_argument(
        "--levels",
        nargs="+",
        choices=list("01234"),
        default=list("134"),
        help="of generated tracks (default: 1 3 4)",
    )
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


def _student_airrace(args) -> list[Case]:
    default = dc.replace(load_scenario(scenario_text=args.scenario_text), laps=args.laps)
    rotor = dc.replace(default, planner=dc.replace(default.planner, limits="rotor"))
    kinds = {f"{d}-D": dc.replace(default, trajectory=d) for d in ORIGINAL_LAPS}
    star_one = dc.replace(default, drone="StarOne")
    kinds = {"optimal": default, **kinds, "optimal, StarOne": star_one, "optimal, rotor": rotor}
    return [Case(name, scenario, range(args.runs)) for name, scenario in kinds.items()]


def _generated(args) -> list[Case]:
    return [
        Case(f"level {level}", lap_of_level(level, args), range(args.tracks), generated=True)
        for level in args.levels
    ]


def lap_of_level(level: str, args) -> Scenario:
    """Returns the scenario of one lap at a level, with what the option --scenario_text says."""
    scenario = load_scenario(
        filename="levels", scenario_name=f"Level{level}", scenario_text=args.scenario_text
    )
    return dc.replace(scenario, laps=1)


_MAKERS = {"student-airrace": _student_airrace, "generated": _generated}


def fly_all(cases: Sequence[Case], workers: int = 1) -> list[dict]:
    """Flies the races of some cases, without recording; returns a row a race.

    Args:
        cases: with names of their own.
        workers: number of processes.

    Returns:
        rows of fly(), or of what takes its place, each with the ``name`` of its case.

    Raises:
        UserError: if a scenario cannot be flown.
    """
    jobs, names = [], []
    for case in cases:
        quiet = dc.replace(case.scenario.recording, content="none")
        for seed in case.seeds:
            scenario = dc.replace(case.scenario, seed=seed, recording=quiet)
            scenario.check()
            jobs.append((case.fly or fly, (_text(scenario), seed if case.generated else None)))
            names.append(case.name)
    for estimator in sorted({case.scenario.estimator for case in cases}):
        compile_apart(Scenario(estimator=estimator))
    rows = harness.in_processes(jobs, "Racing", workers=workers, jobs_each=4)
    return [{"name": name, **row} for name, row in zip(names, rows, strict=True)]


def _text(scenario: Scenario) -> str:
    return yaml_dump_typed(scenario, schema=Scenario)


def fly(scenario_text: str, track_seed: int | None = None) -> dict:
    """Flies a race, and returns its figures.

    Args:
        scenario_text: the fields of its scenario, as YAML.
        track_seed: of its generated track; None for the scenario's own.
    """
    with tempfile.TemporaryDirectory() as folder:
        scenario = scenario_of(scenario_text, track_seed, Path(folder))
        return figures(scenario, fly_race(scenario, Path(folder)))


def scenario_of(scenario_text: str, track_seed: int | None, folder: Path) -> Scenario:
    """Returns the scenario of a race, see fly(); writes its track into a folder."""
    scenario = load_scenario(scenario_text=scenario_text)
    if track_seed is None:
        return scenario
    track = folder / "track.yaml"
    track.write_text(generated_track(track_seed)[1], encoding="utf-8")
    return dc.replace(scenario, track=str(track))


def figures(scenario: Scenario, race: dict) -> dict:
    """Returns the figures of a race from its race.json."""
    laps, exploration = race["laps"], race["exploration"]
    return {
        "seed": scenario.seed,
        "trajectory": scenario.trajectory,
        "finished": race["finished"],
        "dnf_reason": race["dnf_reason"],
        "collisions": race["collisions"],
        "lap_times_s": [lap["time_s"] for lap in laps],
        "gate_offsets_m": [lap["gate_offsets_m"] for lap in laps],
        "map_rms_m": laps[-1]["map_rms_m"] if laps else None,
        "exploration_s": exploration["time_s"] if exploration["success"] else None,
    }


def summary(name: str, rows: list[dict]) -> dict:
    """Returns the figures of a row of a table.

    Args:
        name: of the row.
        rows: of fly().
    """
    laps = [time for row in rows for time in row["lap_times_s"]]
    offsets = [offset for row in rows for lap in row["gate_offsets_m"] for offset in lap]
    maps = [row["map_rms_m"] for row in rows if row["map_rms_m"] is not None]
    times = [row["exploration_s"] for row in rows if row["exploration_s"] is not None]
    return {
        "name": name,
        "races": len(rows),
        "finished": int(column(rows, "finished").sum()),
        "mean_lap_s": float(np.mean(laps)) if laps else None,
        "best_lap_s": min(laps, default=None),
        "worst_gate_offset_m": max(offsets, default=None),
        "map_rms_cm": 100.0 * float(np.mean(maps)) if maps else None,
        "exploration_s": _span(times),
        "reasons": _reasons(rows),
        "original_s": ORIGINAL_LAPS.get(rows[0]["trajectory"]),
    }


def _reasons(rows: list[dict]) -> str:
    """Returns why races did not finish; where several were alike, how many."""
    counts = Counter(dnf_class(row["dnf_reason"]) for row in rows if row["dnf_reason"])
    return "; ".join(f"{n} × {why}" if n > 1 else why for why, n in counts.most_common())


def _span(values: list[float]) -> str:
    """Returns the least and the greatest of some values, "-" if there are none."""
    if not values:
        return "-"
    least, greatest = f"{min(values):.1f}", f"{max(values):.1f}"
    return least if least == greatest else f"{least} to {greatest}"


def summaries(rows: list[dict]) -> list[dict]:
    """Returns a summary() of every case of the rows of fly_all()."""
    return [summary(name, each) for (name,), each in groups(rows, "name")]


def show(results: dict) -> tuple[list, bool]:
    """Returns the tables of what measure() found, and whether all races finished."""
    tables = []
    for name, rows in results.items():
        columns, title = dict(_COLUMNS), "One lap on generated tracks, a race a track"
        if name == "student-airrace":
            columns["the original's mean lap (s)"] = "{original_s:.2f}"
            laps = max(len(row["lap_times_s"]) for row in rows)
            title = f"Races of {laps} laps on the track student-airrace"
        tables.append(harness.make_table(title, summaries(rows), columns))
    finished = all(row["finished"] for row in itertools.chain(*results.values()))
    return tables, finished


if __name__ == "__main__":
    sys.exit(main())
