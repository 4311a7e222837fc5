"""What it costs to record a race, and to watch it live.

    python -m benchmarks.watching [--laps 1] [--rounds 3] [--json FILE]

The same race again and again, in turn: without either, with each kind of recording, and with
the live view, in which nobody looks or one does. Times are of the race alone, without set-up,
report and replay, and compared within a round: other programs disturb a round's races alike.
The recording's size is that of the laps flown; --laps 10 shows that of a whole race.
"""

import argparse
import contextlib
import dataclasses as dc
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console
from rich.progress import track as progress
from rich.table import Table

from airrace.scenario import load_scenario
from airrace.track import load_track
from airrace.visualization.race_view import MakeMeshcat
from benchmarks.timed_race import time_race

# Takes all that the page of the live view gets, as a browser would.
_VIEWER = """
import socket, sys
page = socket.create_connection(("127.0.0.1", int(sys.argv[1])))
page.sendall(b"GET / HTTP/1.1\\r\\nHost: localhost\\r\\nUpgrade: websocket\\r\\n"
             b"Connection: Upgrade\\r\\nSec-WebSocket-Version: 13\\r\\n"
             b"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\\r\\n\\r\\n")
while page.recv(1 << 20):
    print(end=".", flush=True)
"""
PLAIN = "neither"


@dc.dataclass(frozen=True)
class Kind:
    """A way to record and to watch: see RecordingConfig, and how many look at the live view."""

    name: str
    content: str = "none"
    image_rate: float = 5.0  # Hz
    live: bool = False
    viewers: int = 0


KINDS = (
    Kind(PLAIN),
    Kind("recording light", "light"),
    Kind("recording full", "full"),
    Kind("recording full, pictures at 10 Hz", "full", 10.0),
    Kind("live view", live=True),
    Kind("live view that somebody looks at", live=True, viewers=1),
)


def main(argv=None) -> int:
    """Flies the races and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--laps", type=int, default=1, help="of each race (default: 1)")
    parser.add_argument("--rounds", type=int, default=3, help="of all kinds (default: 3)")
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    args = parser.parse_args(argv)
    cv2.setNumThreads(1)
    jobs = [kind for _ in range(args.rounds) for kind in KINDS]
    flown = [
        fly(kind, args.laps) for kind in progress(jobs, "Racing", console=Console(stderr=True))
    ]
    rows = summary(flown)
    Console(width=120).print(make_table(rows))
    if args.json is not None:
        args.json.write_text(json.dumps({"races": flown, "rows": rows}, indent=1))
    return 0


def fly(kind: Kind, laps: int) -> dict:
    """Flies a race; returns ``kind``, ``wall_s``, ``cpu_s``, ``simulated_s``, and ``mcap_mb``."""
    scenario = load_scenario()
    scenario.laps = laps
    scenario.recording.content, scenario.recording.image_rate = kind.content, kind.image_rate
    meshcat = MakeMeshcat(load_track(scenario.track)) if kind.live else None
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as viewers:
        for _ in range(kind.viewers):
            viewers.enter_context(viewer(meshcat.port()))
        _, times = time_race(scenario, Path(folder), meshcat=meshcat)
        log = Path(folder) / "race.mcap"
        size = log.stat().st_size / 1e6 if log.exists() else 0.0
    return {"kind": kind.name, **times, "mcap_mb": size}


@contextlib.contextmanager
def viewer(port: int):
    """Has somebody look at a live view, in a process of their own."""
    with subprocess.Popen(
        [sys.executable, "-c", _VIEWER, str(port)], stdout=subprocess.PIPE
    ) as process:
        try:
            process.stdout.read(1)  # the page has come
            yield
        finally:
            process.kill()


def summary(flown: list) -> list:
    """Returns a row for each kind: medians, and what it adds to the plain race of its round."""
    rounds = [flown[i : i + len(KINDS)] for i in range(0, len(flown), len(KINDS))]
    rows = []
    for k, kind in enumerate(KINDS):
        races = [each[k] for each in rounds]
        row = {"kind": kind.name, "mcap_mb": races[0]["mcap_mb"]}
        for clock in ("wall_s", "cpu_s"):
            row[clock] = float(np.median([race[clock] for race in races]))
            added = [race[clock] / each[0][clock] - 1.0 for race, each in zip(races, rounds)]
            row[f"{clock}_added"] = float(np.median(added))
        rows.append(row)
    return rows


def make_table(rows: list) -> Table:
    """Returns the table of summary()."""
    table = Table(title="To record and to watch")
    for name in ("", "wall (s)", "added", "CPU (s)", "added", "race.mcap (MB)"):
        table.add_column(name, justify="right" if name else "left")
    for row in rows:
        added = [
            f"{100 * row[f'{clock}_added']:+.1f} %" if row["kind"] != PLAIN else ""
            for clock in ("wall_s", "cpu_s")
        ]
        table.add_row(
            row["kind"],
            f"{row['wall_s']:.2f}",
            added[0],
            f"{row['cpu_s']:.2f}",
            added[1],
            f"{row['mcap_mb']:.1f}" if row["mcap_mb"] else "",
        )
    return table


if __name__ == "__main__":
    sys.exit(main())
