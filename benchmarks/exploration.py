"""How reliably the explorer finds the gates of tracks that it has never seen.

    python -m benchmarks.exploration [--tracks 200] [--first 0] [--turned 0] [--blind 0]

Every track is a random one that obeys the rules. The drone flies without physics
and sees without pixels (see tests/worlds/exploration.py), which takes seconds a track.
"""

import argparse
import collections
import json
import sys
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from airrace.math.random import make_generator
from airrace.scenario import Scenario
from airrace.track import Track
from airrace.track.generator import generate_track
from airrace.vehicle import load_vehicle
from benchmarks.control import run
from tests.worlds.exploration import ExplorationWorld, clear_of_pylons, explore, make_explorer

_TIME_LIMIT = 720.0  # s, of a race of one lap
_BLIND_BEYOND = 12.0  # m
_REQUIRED = 0.98  # of the tracks


def main(argv=None) -> int:
    """Prints the table; exit code 1 if too few tracks are explored or one ends in a pylon."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tracks", type=int, default=200, help="how many (default: 200)")
    parser.add_argument("--first", type=int, default=0, help="seed of the first (default: 0)")
    parser.add_argument("--drone", default="Default", help="whose size counts (default: Default)")
    parser.add_argument(
        "--turned",
        type=float,
        default=0.0,
        metavar="DEG",
        help="turn every start by so much more (default: 0)",
    )
    parser.add_argument(
        "--blind",
        type=float,
        default=0.0,
        metavar="SHARE",
        help="of the boards that cannot be read from beyond 12 m (default: 0)",
    )
    parser.add_argument("--workers", type=int, default=1, help="processes (default: 1)")
    parser.add_argument("--json", type=Path, help="also write a row for every track")
    args = parser.parse_args(argv)
    seeds = range(args.first, args.first + args.tracks)
    rows = run(
        [(explore_generated, (seed, args.drone, args.turned, args.blind)) for seed in seeds],
        args.workers,
    )
    console = Console(width=140)
    console.print(summary(rows))
    for row in rows:
        if row["failure"]:
            console.print(
                f"seed {row['seed']}, {row['track']}: {row['failure']}; "
                f"last in {row['state']}: {row['reason']}"
            )
    if args.json is not None:
        args.json.write_text(json.dumps(rows, indent=1))
    succeeded = sum(row["failure"] is None for row in rows)
    return 0 if succeeded >= _REQUIRED * len(rows) and not any(r["hit"] for r in rows) else 1


def explore_generated(seed: int, drone="Default", turned=0.0, blind=0.0) -> dict:
    """Explores the track of a seed; see explore_track().

    Args:
        seed: of the track and of all noise.
        drone: whose size counts.
        turned: angle by which the start is turned (degrees).
        blind: share of the boards that can be read from near only.
    """
    track = generate_track(seed)
    track.start.heading_deg += turned
    hidden = {
        board.id: board.X_WM.translation()
        for board, luck in zip(track.boards(), make_generator(seed, "blind").random(1000))
        if luck < blind
    }

    def too_far(id, p_WC):
        return id in hidden and np.linalg.norm(p_WC - hidden[id]) > _BLIND_BEYOND

    return {"seed": seed, **explore_track(track, seed, drone, hidden=too_far)}


def explore_track(track: Track, seed: int, drone: str = "Default", **sight) -> dict:
    """Explores a track.

    Args:
        track: with the true gates.
        seed: of the noise.
        drone: whose size counts.
        sight: more arguments of ExplorationWorld.

    Returns:
        what happened; ``failure`` is None or says what went wrong.
    """
    scenario = Scenario(drone=drone)
    flown = explore(
        make_explorer(track, scenario),
        ExplorationWorld(track, seed=seed, **sight),
        track,
        _TIME_LIMIT,
    )
    status, n = flown.status, len(track.gates)
    room = clear_of_pylons(flown.path, track, load_vehicle(drone)[0].radius)
    wrong = [
        c for c, expected in zip(flown.crossings, range(len(flown.crossings))) if c != expected
    ] or list(flown.crossings[n:])
    failure = None
    if room < 0.0:
        failure = f"hit a pylon by {-room:.2f} m"
    elif wrong:
        failure = f"flew through {list(flown.crossings)}"
    elif status.gates != tuple(range(n)):
        failure = f"found {len(status.gates)} of {n} gates"
    elif not status.done:
        failure = "is not back at the start"
    return {
        "track": track.name,
        "gates": n,
        "failure": failure,
        "hit": room < 0.0,
        "time_s": status.closed_at,
        "room_m": room,
        "wrong_gaps": len(wrong),
        "length_m": float(np.linalg.norm(np.diff(flown.path, axis=0), axis=1).sum()),
        "state": status.state,
        "reason": status.reason,
        "events": [[e.time, e.state, e.reason] for e in status.events],
    }


def summary(rows) -> Table:
    """Returns the table of rows of explore_track()."""
    table = Table(title=f"Exploration of {len(rows)} tracks", show_header=False)
    good = [row for row in rows if row["failure"] is None]
    times = [row["time_s"] for row in good] or [np.nan]
    speeds = [row["length_m"] / row["time_s"] for row in good] or [np.nan]
    states = collections.Counter(state for row in rows for _, state, _ in row["events"])
    table.add_row("explored and back home", f"{len(good)} ({len(good) / len(rows):.1%})")
    table.add_row("hit a pylon", str(sum(row["hit"] for row in rows)))
    table.add_row("flew through a wrong gap", str(sum(row["wrong_gaps"] > 0 for row in rows)))
    table.add_row("least room to a pylon", f"{min(row['room_m'] for row in rows):.2f} m")
    table.add_row(
        "time to the closed loop, mean and longest", f"{np.mean(times):.1f} s, {max(times):.1f} s"
    )
    table.add_row("mean speed", f"{np.mean(speeds):.1f} m/s")
    table.add_row("states entered", ", ".join(f"{s} {c}" for s, c in sorted(states.items())))
    return table


if __name__ == "__main__":
    sys.exit(main())
