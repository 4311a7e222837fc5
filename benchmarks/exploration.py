"""How reliably the explorer finds the gates of tracks that it has never seen.

    python -m benchmarks.exploration [--tracks 200] [--first 0] [--turned 0] [--blind 0]

Every track is a random one that obeys the rules. The drone flies without physics
and sees without pixels (tests/worlds/exploration.py), which takes seconds a track.
"""

import collections
import sys

import numpy as np

from airrace.math.random import make_generator
from airrace.scenario import Scenario
from airrace.track import Track
from airrace.track.generator import generate_track
from airrace.vehicle import load_vehicle
from benchmarks import harness
from benchmarks.harness import column
from tests.worlds.exploration import ExplorationWorld, clear_of_pylons, explore, make_explorer

_TIME_LIMIT = 720.0  # s, of a race of one lap
_BLIND_BEYOND = 12.0  # m
_REQUIRED = 0.98  # of the tracks


def main(argv=None) -> int:
    """Prints the table; exit code 1 if too few tracks are explored or one ends in a pylon."""
    parser = harness.make_parser(__doc__)
    parser.add_argument("--tracks", type=harness.count, default=200, help="how many (default: 200)")
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
    parser.add_argument("--workers", type=harness.count, default=1, help="processes (default: 1)")
    return harness.run(parser, argv, measure, show)


def measure(args) -> list:
    """Returns a row for every track."""
    jobs = [
        (explore_generated, (seed, args.drone, args.turned, args.blind))
        for seed in range(args.first, args.first + args.tracks)
    ]
    return harness.in_processes(jobs, "Exploring", workers=args.workers, jobs_each=100)


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
        for board, draw in zip(track.boards(), make_generator(seed, "blind").random(1000))
        if draw < blind
    }

    def too_far(id, p_WC):
        return id in hidden and np.linalg.norm(p_WC - hidden[id]) > _BLIND_BEYOND

    world = ExplorationWorld(track, seed=seed, hidden=too_far)
    return {"seed": seed, **explore_track(track, world, drone)}


def explore_track(track: Track, world: ExplorationWorld, drone: str) -> dict:
    """Explores a track.

    Args:
        track: with the true gates.
        world: of that track.
        drone: whose size counts.

    Returns:
        what happened; ``failure`` is None or says what went wrong.
    """
    flown = explore(make_explorer(track, Scenario(drone=drone)), world, track, _TIME_LIMIT)
    status, n = flown.status, len(track.gates)
    room = clear_of_pylons(flown.path, track, load_vehicle(drone)[0].radius)
    wrong = [crossing for k, crossing in enumerate(flown.crossings) if crossing != k]
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
        "events": [[event.time, event.state, event.reason] for event in status.events],
    }


def show(rows: list) -> tuple[list, bool]:
    """Returns the table of the rows, a line for each failure, and whether the bounds are kept."""
    good = [row for row in rows if row["failure"] is None]
    times = column(good, "time_s") if good else np.array([np.nan])
    speeds = column(good, "length_m") / times if good else times
    states = collections.Counter(state for row in rows for _, state, _ in row["events"])
    hits = sum(row["hit"] for row in rows)
    figures = {
        "explored and back home": f"{len(good)} ({len(good) / len(rows):.1%})",
        "hit a pylon": hits,
        "flew through a wrong gap": sum(row["wrong_gaps"] > 0 for row in rows),
        "least room to a pylon": f"{column(rows, 'room_m').min():.2f} m",
        "time to the closed loop, mean and longest": f"{times.mean():.1f} s, {times.max():.1f} s",
        "mean speed": f"{speeds.mean():.1f} m/s",
        "states entered": ", ".join(f"{state} {n}" for state, n in sorted(states.items())),
    }
    failures = [
        f"seed {row['seed']}, {row['track']}: {row['failure']}; "
        f"last in {row['state']}: {row['reason']}"
        for row in rows
        if row["failure"]
    ]
    table = harness.make_list(f"Exploration of {len(rows)} tracks", figures)
    return [table, *failures], len(good) >= _REQUIRED * len(rows) and not hits


if __name__ == "__main__":
    sys.exit(main())
