"""What the page of a race costs it, and how large its replay is.

    python -m benchmarks.page_cost [--track hexagon] [--laps 2] [--runs 3] [--json FILE]

Each run flies a race from pixels three times, one after the other: without a page, with one
that nobody watches, and with one that somebody does, who is another process here and reads
all that a browser would. Counted is the CPU time of the race's process alone.
"""

import asyncio
import multiprocessing
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import tornado.websocket

from airrace.diagrams.warm_up import compile_apart
from airrace.scenario import load_scenario
from airrace.track import load_track
from airrace.visualization.live_page import LivePage
from benchmarks import harness
from benchmarks.whole_race import fly_race

ALONE, UNWATCHED, WATCHED = "without a page", "with a page", "and somebody watches"
_MOST = 1.10  # times as long as alone
_TITLE = f"A race and its page, medians (bound: {_MOST:.2f} times the CPU time of the race alone)"


def main(argv=None) -> int:
    """Flies the races and prints the table; exit code 1 if a page costs more than the bound."""
    parser = harness.make_parser(__doc__, runs=3)
    parser.add_argument("--track", default="hexagon", help="default: %(default)s")
    parser.add_argument("--laps", type=harness.count, default=2, help="default: %(default)s")
    parser.add_argument(
        "--scenario_text", metavar="YAML", help="scenario fields on top of the default"
    )
    return harness.run(parser, argv, measure, show)


def measure(args) -> list:
    """Returns a row for every race."""
    options = args.track, args.laps, args.scenario_text
    compile_apart(load_scenario(scenario_text=args.scenario_text))
    kinds = (ALONE, UNWATCHED, WATCHED)
    jobs = [(fly, (kind, *options)) for _ in range(args.runs) for kind in kinds]
    return harness.in_processes(jobs, "Racing")


def fly(kind: str, track: str, laps: int, scenario_text: str | None) -> dict:
    """Returns what a race takes (s), and how large its replay is (MB)."""
    scenario = load_scenario(scenario_text=scenario_text)
    scenario.track, scenario.laps = track, laps
    with tempfile.TemporaryDirectory() as folder:
        if kind == ALONE:
            return {"kind": kind, "replay_mb": np.nan, **_timed(scenario, Path(folder), None)}
        with LivePage(load_track(track)) as page:
            watcher = None
            if kind == WATCHED:
                context = multiprocessing.get_context("spawn")
                watcher = context.Process(target=_watch, args=(page.url,), daemon=True)
                watcher.start()
                while page.meshcat.GetNumActiveConnections() < 1 or page.watching < 1:
                    time.sleep(0.01)
            result = _timed(scenario, Path(folder), page)
        if watcher is not None:
            watcher.terminate()
            watcher.join()
        size = (Path(folder) / "race.html").stat().st_size / 1e6
        return {"kind": kind, "replay_mb": size, **result}


def _timed(scenario, folder, page):
    start = time.process_time()
    result = fly_race(scenario, folder, page=page)
    cpu = time.process_time() - start
    simulated = result["wall"]["seconds"] * result["wall"]["real_time_factor"]
    return {"cpu_s": cpu, "simulated_s": simulated, "finished": result["finished"]}


def _watch(url):
    """Reads all that a page is sent, until the process is ended."""

    async def read(path):
        address = url.replace("http", "ws") + path
        socket = await tornado.websocket.websocket_connect(address, max_message_size=1 << 30)
        while await socket.read_message() is not None:
            pass

    async def both():
        await asyncio.gather(read("/"), read("/race"))

    asyncio.run(both())


def show(rows: list) -> tuple[list, bool]:
    """Returns the table of the rows, and whether the page keeps to the bound."""
    medians = {
        kind: float(
            np.median(harness.column(group, "cpu_s") / harness.column(group, "simulated_s"))
        )
        for (kind,), group in harness.groups(rows, "kind")
    }
    summary = [
        {
            "kind": kind,
            "races": len(group),
            "cpu": medians[kind],
            "ratio": medians[kind] / medians[ALONE],
            "replay_mb": float(np.median(harness.column(group, "replay_mb"))),
        }
        for (kind,), group in harness.groups(rows, "kind")
    ]
    columns = {
        "race": "{kind}",
        "races": "{races}",
        "CPU s a simulated s": "{cpu:.3f}",
        "times alone": "{ratio:.2f}",
        "race.html (MB)": "{replay_mb:.1f}",
    }
    table = harness.make_table(_TITLE, summary, columns)
    kept = all(row["ratio"] <= _MOST for row in summary)
    return [table], kept and all(np.isfinite(list(medians.values())))


if __name__ == "__main__":
    sys.exit(main())
