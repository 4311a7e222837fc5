"""How fast a race is, and what takes its time.

    python -m benchmarks.race_speed [--profile] [--laps 2] [--runs 1] [--drone NAME]
        [--renderer planar|vtk|none] [--record none|light|full]

A race is flown from pixels on one core; each of several runs in a process of its own.
Wall time and CPU time differ when the machine has other work, too; ratios to the simulated
time are given for both. With --profile, a second table shows the CPU time of every box; a
box counts without the boxes whose outputs it asks for. Watching makes the race some percent
slower. With --renderer vtk, a last table holds a frame against Drake's own camera: see
vtk_frame.py.
"""

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console
from rich.progress import Progress, TextColumn
from rich.table import Table

from airrace.common.errors import exit_code
from airrace.diagrams.race import run_race
from airrace.diagrams.warm_up import compile_apart
from airrace.scenario import load_scenario
from airrace.scenario.camera import NO_CAMERA, RENDERERS
from airrace.scenario.recording import CONTENTS
from airrace.track.map_files import TRACK
from benchmarks import vtk_frame
from benchmarks.fresh import in_fresh_processes, one_thread_each
from benchmarks.stopwatch import Stopwatch, watching

SET_UP, EXPLORATION, LAPS = "set-up", "exploration", "laps"
REST = "runner: looks, files, set-up"
# Parts of boxes, and what is no box.
PARTS = {
    "airrace.rendering.planar.exposure:Exposure.draw": "Camera: drawing",
    "airrace.rendering.vtk.vtk_renderer:VtkRenderer.render": "Camera: drawing",
    "airrace.rendering.imaging.pixel_maps:PixelMap.bend": "lens and Rectifier: bending",
    "airrace.rendering.imaging.sensor:Sensor.expose": "Camera: sensor",
    "airrace.systems.perception.marker_search:MarkerSearch.everywhere": "ArucoDetector: all of it",
    "airrace.systems.perception.marker_search:MarkerSearch.around": "ArucoDetector: regions",
    "airrace.systems.perception.marker_measurement:refit": "ArucoDetector: corners",
    "airrace.systems.perception.aruco_detector:measure": "ArucoDetector: checks, poses",
    "pydrake.systems.analysis:Simulator.AdvanceTo": "Drake: plant step, Simulator",
}


def main(argv=None) -> int:
    """Flies the races and prints the tables; exit code 1 if one did not finish."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--profile", action="store_true", help="also show the time of every box")
    parser.add_argument("--laps", type=int, default=2, help="after exploring (default: 2)")
    parser.add_argument(
        "--runs", type=int, default=1, help="races, of which medians are shown (default: 1)"
    )
    parser.add_argument("--drone", default="Default", help="a shipped drone, or a folder")
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
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    args = parser.parse_args(argv)
    if args.runs < 1:
        parser.error("--runs must be at least 1")
    if args.profile and args.runs > 1:
        parser.error("--profile looks at one race; leave out --runs")
    return exit_code(lambda: _run(args))


def _run(args) -> int:
    scenario = make_scenario(args)
    compile_apart(scenario)
    one_thread_each()
    results = list(in_fresh_processes(fly, args.runs * [(args,)]))
    console, report = Console(width=120), {"runs": results}
    console.print(speed_table(results))
    if args.profile:
        console.print(box_table(results[0]))
    if scenario.camera.renderer == "vtk":
        report["frame_ms"] = vtk_frame.measure()
        console.print(vtk_frame.make_table(report["frame_ms"]))
    if args.json is not None:
        args.json.write_text(json.dumps(report, indent=1))
    return 0 if all(result["race"]["finished"] for result in results) else 1


def make_scenario(args):
    """Returns the checked Scenario that main()'s arguments ask for."""
    scenario = load_scenario(scenario_text=args.scenario_text)
    scenario.laps, scenario.drone = args.laps, args.drone
    scenario.camera.renderer = args.renderer or scenario.camera.renderer
    if scenario.camera.renderer == NO_CAMERA:
        scenario.map = scenario.map or TRACK
    scenario.recording.content = args.record
    scenario.check()
    return scenario


def fly(args) -> dict:
    """Returns what measure() does for main()'s arguments, on one core."""
    cv2.setNumThreads(1)
    return measure(make_scenario(args), profile=args.profile)


def measure(scenario, *, profile: bool) -> dict:
    """Flies a race.

    Args:
        scenario: of the race.
        profile: whether to watch the boxes.

    Returns:
        ``race``: its race.json; ``phases``: name to ``simulated_s``, ``wall_s``,
        ``cpu_s`` and ``boxes``, name to ``seconds`` and ``calls``, which is
        empty without profile.
    """
    stopwatch = Stopwatch(REST)
    starts = []  # of the phases, and the end: simulated, wall, CPU time, boxes

    def mark(simulated):
        boxes = stopwatch.snapshot() if profile else {}
        starts.append((simulated, time.perf_counter(), time.process_time(), boxes))

    with Progress(
        *Progress.get_default_columns()[:1],
        TextColumn("{task.fields[clock]}"),
        console=Console(stderr=True),
        transient=True,
    ) as progress:
        task = progress.add_task("Racing", total=None, clock="")

        def show(record, look):
            if len(starts) == 1:  # the first look: all is set up
                mark(look.time)
            if look.explorer_status.done and len(starts) == 2:
                mark(look.time)
            if round(10 * look.time) % 10 == 0:
                progress.update(task, clock=f"{look.time:.0f} s simulated")
            show.time = look.time

        with tempfile.TemporaryDirectory() as folder:
            mark(0.0)
            if profile:
                with watching(stopwatch, PARTS):
                    race = run_race(scenario, Path(folder), show=show)
            else:
                race = run_race(scenario, Path(folder), show=show)
            mark(show.time)
    return {
        "race": race,
        "phases": {
            name: _between(start, end)
            for name, start, end in zip((SET_UP, EXPLORATION, LAPS), starts, starts[1:])
        },
    }


def _between(start, end) -> dict:
    boxes = {}
    for name, (seconds, calls) in end[3].items():
        before = start[3].get(name, (0.0, 0))
        boxes[name] = {"seconds": seconds - before[0], "calls": calls - before[1]}
    simulated, wall, cpu = (b - a for a, b in zip(start[:3], end[:3]))
    return {"simulated_s": simulated, "wall_s": wall, "cpu_s": cpu, "boxes": boxes}


def speed_table(results) -> Table:
    """Returns the table of speeds of what measure() returned, of one race or of several."""
    race, several = results[0]["race"], len(results) > 1
    table = Table(
        title=f"{race['drone']} on {race['track']}" + several * f", medians of {len(results)} races"
    )
    for name in (
        "",
        "simulated (s)",
        "wall (s)",
        "CPU (s)",
        "x real time",
        "x real time, CPU",
        *several * ("least", "most"),
    ):
        table.add_column(name, justify="right")
    times = [_times(result["phases"]) for result in results]
    for name in times[0]:
        rows = np.array([each[name] for each in times if name in each])
        simulated, wall, cpu = np.median(rows, axis=0)
        rates = rows[:, :1] / rows[:, 1:]
        table.add_row(
            name,
            f"{simulated:.1f}",
            f"{wall:.2f}",
            f"{cpu:.2f}",
            *(f"{rate:.2f}" for rate in np.median(rates, axis=0)),
            *several * (f"{rates[:, 0].min():.2f}", f"{rates[:, 0].max():.2f}"),
        )
    return table


def _times(phases) -> dict:
    """Returns simulated, wall and CPU time of every phase, and of all together, (3,) s."""
    times = {
        name: np.array([phase[key] for key in ("simulated_s", "wall_s", "cpu_s")])
        for name, phase in phases.items()
    }
    return times | {"all": sum(times.values())}


def box_table(result) -> Table:
    """Returns the table of boxes of what measure() returns, with profile."""
    table = Table(title="CPU time, ms for each simulated second")
    phases = {
        name: result["phases"][name] for name in (EXPLORATION, LAPS) if name in result["phases"]
    }
    table.add_column("box")
    for name in phases:
        for heading in (name, "calls/s", "us a call"):
            table.add_column(heading, justify="right")

    def cells(phase, seconds, calls):
        simulated = max(phase["simulated_s"], 1e-9)
        rate = f"{calls / simulated:.0f}" if calls else "-"
        return (
            f"{1e3 * seconds / simulated:.1f}",
            rate,
            f"{1e6 * seconds / calls:.1f}" if calls else "-",
        )

    none = {"seconds": 0.0, "calls": 0}
    rows = {box for phase in phases.values() for box in phase["boxes"]}
    for box in sorted(rows):
        table.add_row(
            box,
            *(
                cell
                for phase in phases.values()
                for cell in cells(phase, *phase["boxes"].get(box, none).values())
            ),
        )
    table.add_section()
    sums = {name: sum(b["seconds"] for b in p["boxes"].values()) for name, p in phases.items()}
    table.add_row("sum of the rows", *(c for n, p in phases.items() for c in cells(p, sums[n], 0)))
    table.add_row("CPU time", *(c for p in phases.values() for c in cells(p, p["cpu_s"], 0)))
    return table


if __name__ == "__main__":
    sys.exit(main())
