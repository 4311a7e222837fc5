"""How fast a race is, and what takes its time.

    python -m benchmarks.race_speed [--profile] [--laps 2] [--runs 1] [--drone NAME]
        [--estimators truth|vio ...] [--renderer planar|vtk|none] [--record none|light|full]

A race is flown from pixels on one core; each of several runs in a process of its own.
Wall time and CPU time differ when the machine has other work, too; ratios to the simulated
time are given for both. With --profile, a second table shows the CPU time of every box; a
box counts without the boxes whose outputs it asks for. Measuring the boxes makes the race
some percent slower. With two --estimators, races with the one and the other take turns, and a
table says how much slower the second is. With --renderer vtk, a last table compares a frame with
one of Drake's own camera: see vtk_frame.py.
"""

import dataclasses as dc
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydrake.common.yaml import yaml_dump_typed

from airrace.common.errors import UserError
from airrace.diagrams.warm_up import compile_apart
from airrace.recording.race_events import ExplorerChanged
from airrace.scenario import CONTENTS, TRUTH, VIO, Scenario, load_scenario
from airrace.scenario.camera_config import NO_CAMERA, RENDERERS
from airrace.track.map_files import TRACK
from benchmarks import harness, vtk_frame
from benchmarks.box_times import BoxTimes
from benchmarks.whole_race import fly_race

SET_UP, EXPLORATION, LAPS = "set-up", "exploration", "laps"
TIMES = ("simulated_s", "wall_s", "cpu_s")
_REST = "runner: status, files, set-up"
# Parts of boxes, and what is no box.
_PARTS = {
    "airrace.rendering.planar.renderer.Exposure.draw": "Camera: drawing",
    "airrace.rendering.vtk.vtk_renderer.VtkRenderer.render": "Camera: drawing",
    "airrace.rendering.imaging.lens.PixelMap.bend": "lens and Rectifier: bending",
    "airrace.rendering.imaging.sensor.Sensor.expose": "Camera: sensor",
    "airrace.systems.perception.marker_search.MarkerSearch.everywhere": "ArucoDetector: all of it",
    "airrace.systems.perception.marker_search.MarkerSearch.around": "ArucoDetector: regions",
    "airrace.systems.perception.marker_measurement.refit": "ArucoDetector: corners",
    "airrace.systems.perception.aruco_detector.measure": "ArucoDetector: checks, poses",
    "pydrake.systems.analysis.Simulator.AdvanceTo": "Drake: plant step, Simulator",
}


class Instant(NamedTuple):
    """The start of a phase: simulated, wall and CPU time (s), and those of the boxes."""

    simulated: float
    wall: float
    cpu: float
    seconds: Counter
    calls: Counter


def main(argv=None) -> int:
    """Flies the races and prints the tables; exit code 1 if one did not finish."""
    parser = harness.make_parser(__doc__, runs=1)
    parser.add_argument("--profile", action="store_true", help="also show the time of every box")
    parser.add_argument("--laps", type=int, default=2, help="after exploring (default: 2)")
    parser.add_argument("--drone", default="Default", help="a shipped drone, or a folder")
    parser.add_argument(
        "--estimators", nargs="+", choices=(TRUTH, VIO), help="(default: the scenario's)"
    )
    parser.add_argument(
        "--renderer",
        choices=(*RENDERERS, NO_CAMERA),
        help=f"(default: {RENDERERS[0]}); {NO_CAMERA} = laps without a camera, "
        "on a map that is given",
    )
    parser.add_argument(
        "--record", choices=CONTENTS, default="none", help="what race.mcap holds (default: none)"
    )
    parser.add_argument(
        "--scenario_text",
        metavar="YAML",
        help="scenario fields on top, e.g. '{camera: {preset: harsh}}'",
    )
    return harness.run(parser, argv, measure, show)


def measure(args) -> dict:
    """Returns ``runs``, estimator to those of fly(), and with vtk ``frame_ms``: see vtk_frame."""
    if args.profile and args.runs > 1:
        raise UserError("--profile is of one race; leave out --runs.")
    scenario = load_scenario(scenario_text=args.scenario_text)
    scenario.laps, scenario.drone = args.laps, args.drone
    scenario.camera.renderer = args.renderer or scenario.camera.renderer
    if scenario.camera.renderer == NO_CAMERA:
        scenario.map = scenario.map or TRACK
    scenario.recording.content = args.record
    estimators = args.estimators or [scenario.estimator]
    texts = []
    for estimator in estimators:
        each = dc.replace(scenario, estimator=estimator)
        each.check()
        compile_apart(each)
        texts.append(yaml_dump_typed(each, schema=Scenario))
    jobs = args.runs * [(fly, (text, args.profile)) for text in texts]
    runs = harness.in_processes(jobs, "Racing")
    results = {"runs": {name: runs[i :: len(texts)] for i, name in enumerate(estimators)}}
    if scenario.camera.renderer == "vtk":
        results["frame_ms"] = vtk_frame.measure()
    return results


def fly(scenario_text: str, profile: bool = False) -> dict:
    """Flies a race.

    Args:
        scenario_text: the fields of its scenario, as YAML.
        profile: whether to measure the boxes.

    Returns:
        ``race``: its race.json; ``phases``: name to TIMES and ``boxes``, name to
        ``seconds`` and ``calls``, which is empty without profile.
    """
    scenario = load_scenario(scenario_text=scenario_text)
    boxes, starts, now = BoxTimes(_REST), [], 0.0

    def mark():
        starts.append(
            Instant(
                now, time.perf_counter(), time.process_time(), boxes.seconds(), boxes.calls.copy()
            )
        )

    def take(event):
        nonlocal now
        now = event.time
        if len(starts) == 1:  # called for the first time: all is set up
            mark()
        explored = isinstance(event, ExplorerChanged) and event.status.done
        if explored and len(starts) == 2:
            mark()

    with tempfile.TemporaryDirectory() as folder:
        mark()
        if profile:
            with boxes.measuring(_PARTS):
                race = fly_race(scenario, Path(folder), sinks=[take])
        else:
            race = fly_race(scenario, Path(folder), sinks=[take])
        mark()
    phases = zip((SET_UP, EXPLORATION, LAPS), starts, starts[1:])
    return {
        "race": race,
        "phases": {name: _phase(start, end, profile) for name, start, end in phases},
    }


def _phase(start: Instant, end: Instant, profile: bool) -> dict:
    boxes = {
        name: {
            "seconds": end.seconds[name] - start.seconds[name],
            "calls": end.calls[name] - start.calls[name],
        }
        for name in end.seconds
    }
    times = {name: after - before for name, before, after in zip(TIMES, start, end)}
    return times | {"boxes": boxes if profile else {}}


def show(results: dict) -> tuple[list, bool]:
    """Returns the tables, and whether all races finished."""
    tables = []
    for estimator, runs in results["runs"].items():
        tables.append(speed_table(runs, estimator))
        if runs[0]["phases"][SET_UP]["boxes"]:
            tables.append(box_table(runs[0]["phases"]))
    if len(results["runs"]) > 1:
        tables.append(ratio_table(results["runs"]))
    if "frame_ms" in results:
        tables.append(vtk_frame.make_table(results["frame_ms"]))
    flown = [run["race"] for runs in results["runs"].values() for run in runs]
    return tables, all(race["finished"] for race in flown)


def ratio_table(runs: dict):
    """Returns the table of the speed of later estimators by that of the first, turn by turn."""
    (first, reference), *others = runs.items()
    rows = []
    for name, each in others:
        for phase in (EXPLORATION, LAPS):
            pairs = [
                (a["phases"][phase], b["phases"][phase])
                for a, b in zip(reference, each)
                if phase in a["phases"] and phase in b["phases"]
            ]
            ratios = [
                (b["simulated_s"] / b["cpu_s"]) / (a["simulated_s"] / a["cpu_s"]) for a, b in pairs
            ]
            if ratios:
                least, most = min(ratios), max(ratios)
                row = {"name": name, "phase": phase, "ratio": np.median(ratios)}
                rows.append(row | {"least": least, "most": most})
    columns = {
        "": "{name}",
        "phase": "{phase}",
        f"speed, by that with {first}": "{ratio:.2f}",
        "least": "{least:.2f}",
        "most": "{most:.2f}",
    }
    return harness.make_table("What the estimator costs, of CPU time", rows, columns)


def speed_table(runs: list, estimator: str):
    """Returns the table of speeds of one race, or the medians of several."""
    times = {}  # of each phase, and of all together, (runs, 3)
    for run in runs:
        phases = {name: [phase[key] for key in TIMES] for name, phase in run["phases"].items()}
        phases["all"] = np.sum(list(phases.values()), axis=0)
        for name, each in phases.items():
            times.setdefault(name, []).append(each)
    rows = []
    for name, each in times.items():
        simulated, wall, cpu = np.transpose(each)
        figures = {"simulated": simulated, "wall": wall, "cpu": cpu}
        figures |= {"speed": simulated / wall, "cpu_speed": simulated / cpu}
        medians = {key: np.median(values) for key, values in figures.items()}
        slowest, fastest = figures["speed"].min(), figures["speed"].max()
        rows.append({"phase": name, **medians, "slowest": slowest, "fastest": fastest})
    columns = {
        "": "{phase}",
        "simulated (s)": "{simulated:.1f}",
        "wall (s)": "{wall:.2f}",
        "CPU (s)": "{cpu:.2f}",
        "x real time": "{speed:.2f}",
        "x real time, CPU": "{cpu_speed:.2f}",
    }
    title = f"{runs[0]['race']['drone']} on {runs[0]['race']['track']}, {estimator}"
    if len(runs) > 1:
        columns |= {"least": "{slowest:.2f}", "most": "{fastest:.2f}"}
        title += f", medians of {len(runs)} races"
    return harness.make_table(title, rows, columns)


def box_table(phases: dict):
    """Returns the table of the boxes of a race, of what fly() returns."""
    phases = {name: phases[name] for name in (EXPLORATION, LAPS) if name in phases}
    names = sorted({box for phase in phases.values() for box in phase["boxes"]})
    rows = {name: {"box": name} for name in (*names, "sum of the rows", "CPU time")}
    for phase, times in phases.items():
        sums = {"seconds": sum(box["seconds"] for box in times["boxes"].values()), "calls": 0}
        whole = {"seconds": times["cpu_s"], "calls": 0}
        for name, box in (times["boxes"] | {"sum of the rows": sums, "CPU time": whole}).items():
            rows[name][phase] = 1e3 * box["seconds"] / times["simulated_s"]
            rows[name][f"{phase} calls"] = box["calls"] / times["simulated_s"] or None
            rows[name][f"{phase} us"] = 1e6 * box["seconds"] / (box["calls"] or np.nan)
    columns = {"box": "{box}"}
    for phase in phases:
        columns[phase] = f"{{{phase}:.1f}}"
        columns[f"{phase}, calls/s"] = f"{{{phase} calls:.0f}}"
        columns[f"{phase}, us a call"] = f"{{{phase} us:.1f}}"
    return harness.make_table("CPU time, ms for each simulated second", rows.values(), columns)


if __name__ == "__main__":
    sys.exit(main())
