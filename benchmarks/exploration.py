"""How reliably the explorer finds the gates of tracks that it has never seen.

    python -m benchmarks.exploration [--tracks 200] [--first 0] [--turned 0] [--blind 0]
    python -m benchmarks.exploration --step_length 2 5 10 15 25 --student_airrace --tracks 40

Every track is a random one that obeys the rules. The drone flies without physics
and sees without pixels (tests/worlds/exploration.py), which takes seconds a track.
"""

import collections
import sys

import numpy as np

from airrace.math.random import make_generator
from airrace.scenario import Scenario
from airrace.track import Track, load_track
from airrace.track.generator import generate_track
from airrace.vehicle import load_vehicle
from benchmarks import harness
from benchmarks.harness import column
from tests.worlds.exploration import ExplorationWorld, clear_of_pylons, explore, make_explorer

_TRACK = "student-airrace"
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
    parser.add_argument(
        "--step_length",
        type=float,
        nargs="+",
        default=[Scenario().explorer.step_length],
        metavar="M",
        help="of the explorer's steps forward, a row each (default: the scenario's)",
    )
    parser.add_argument(
        "--student_airrace", action="store_true", help=f"also the track student-airrace, {_TRACK}"
    )
    parser.add_argument("--workers", type=harness.count, default=1, help="processes (default: 1)")
    return harness.run(parser, argv, measure, show)


def measure(args) -> list:
    """Returns a row for every track and length of a step."""
    seeds = [None] * args.student_airrace + list(range(args.first, args.first + args.tracks))
    for step_length in args.step_length:
        _scenario(args.drone, step_length).check()
    jobs = [
        (explore_one, (seed, step_length, args.drone, args.turned, args.blind))
        for step_length in args.step_length
        for seed in seeds
    ]
    return harness.in_processes(jobs, "Exploring", workers=args.workers, jobs_each=100)


def _scenario(drone: str, step_length: float) -> Scenario:
    """Returns the scenario with a drone and steps of a length (m)."""
    scenario = Scenario(drone=drone)
    scenario.explorer.step_length = step_length
    return scenario


def explore_one(
    seed: int | None, step_length: float, drone="Default", turned=0.0, blind=0.0
) -> dict:
    """Explores the track of a seed; see explore_track().

    Args:
        seed: of the track and of all noise; None for the track student-airrace.
        step_length: of a step forward (m).
        drone: whose size counts.
        turned: angle by which the start is turned (degrees).
        blind: share of the boards that can be read from near only.
    """
    track = load_track(_TRACK) if seed is None else generate_track(seed)
    track.start.heading_deg += turned
    hidden = {
        board.id: board.X_WM.translation()
        for board, draw in zip(track.boards(), make_generator(seed or 0, "blind").random(1000))
        if draw < blind
    }

    def too_far(id, p_WC):
        return id in hidden and np.linalg.norm(p_WC - hidden[id]) > _BLIND_BEYOND

    world = ExplorationWorld(track, seed=seed or 0, hidden=too_far)
    flown = explore_track(track, world, _scenario(drone, step_length))
    return {"seed": seed, "step_length_m": step_length, **flown}


def explore_track(track: Track, world: ExplorationWorld, scenario: Scenario) -> dict:
    """Explores a track.

    Args:
        track: with the true gates.
        world: of that track.
        scenario: with the explorer, and the drone whose size counts.

    Returns:
        what happened; ``failure`` is None or says what went wrong.
    """
    flown = explore(make_explorer(track, scenario), world, track, _TIME_LIMIT)
    status, n = flown.status, len(track.gates)
    room = clear_of_pylons(flown.path, track, load_vehicle(scenario.drone)[0].radius)
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
        "home_s": status.since if status.done else None,
        "room_m": room,
        "wrong_gaps": len(wrong),
        "length_m": float(np.linalg.norm(np.diff(flown.path, axis=0), axis=1).sum()),
        "state": status.state,
        "reason": status.reason,
        "events": [[event.time, event.state, event.reason] for event in status.events],
    }


def show(rows: list) -> tuple[list, bool]:
    """Returns the table, its states and failures in lines, and whether the bounds are kept."""
    by_step = [group for _, group in harness.groups(rows, "step_length_m")]
    summaries = [_summary(group) for group in by_step]
    table = harness.make_table(
        "Exploration, by the length of a step forward; times are to the closed loop",
        summaries,
        {
            "step (m)": "{step_length_m:g}",
            "explored and back home": "{home} of {tracks}",
            "hit a pylon": "{hits}",
            "flew through a wrong gap": "{wrong}",
            "least room to a pylon (m)": "{room_m:.2f}",
            "mean (s)": "{mean_s:.1f}",
            "longest (s)": "{longest_s:.1f}",
            "mean speed (m/s)": "{speed:.1f}",
            "student-airrace (s)": "{first_s:.1f}",
            "... home again (s)": "{first_home_s:.1f}",
        },
    )
    states = [_states(group) for group in by_step]
    failures = [
        f"seed {row['seed']}, {row['track']}, steps of {row['step_length_m']:g} m: "
        f"{row['failure']}; last in {row['state']}: {row['reason']}"
        for row in rows
        if row["failure"]
    ]
    passed = all(
        each["home"] >= _REQUIRED * each["tracks"] and not each["hits"] for each in summaries
    )
    return [table, *states, *failures], passed


def _summary(rows: list) -> dict:
    """Returns what the table says of the tracks explored in steps of one length."""
    good = [row for row in rows if row["failure"] is None]
    times = column(good, "time_s") if good else np.array([np.nan])
    first = next((row for row in rows if row["seed"] is None), {})
    return {
        "step_length_m": rows[0]["step_length_m"],
        "tracks": len(rows),
        "home": len(good),
        "hits": sum(row["hit"] for row in rows),
        "wrong": sum(row["wrong_gaps"] > 0 for row in rows),
        "room_m": float(column(rows, "room_m").min()),
        "mean_s": float(times.mean()),
        "longest_s": float(times.max()),
        "speed": float((column(good, "length_m") / times).mean()) if good else np.nan,
        "first_s": first.get("time_s"),
        "first_home_s": first.get("home_s"),
    }


def _states(rows: list) -> str:
    """Returns a line that says how often each state was entered in steps of one length."""
    states = collections.Counter(state for row in rows for _, state, _ in row["events"])
    entered = ", ".join(f"{state} {n}" for state, n in sorted(states.items()))
    return f"states entered with steps of {rows[0]['step_length_m']:g} m: {entered}"


if __name__ == "__main__":
    sys.exit(main())
