"""How well the drones are controlled: recovery, tracking, wind, lost rotors.

    python -m benchmarks.control [--quick] [--only recovery tracking wind loss]
                                 [--json FILE] [--workers N]

Bounds in the titles are what the controller is meant to keep. All but the races
fly with the control alone, along a reference, and start in the air. The results
do not depend on the number of workers.
"""

import argparse
import itertools
import json
import multiprocessing
import os
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from rich.console import Console
from rich.progress import Progress

from airrace.vehicle import DRONES, load_vehicle
from benchmarks.control_tables import TABLES
from benchmarks.experiments import loss, race, recovery, tracking
from benchmarks.fresh import one_thread_each

_NOISES = ("none", "reference")
# Name, shipped scenario, YAML on top of it, number of seeds.
_TRACKING_CASES = (
    ("nominal", "Defaults", "", 1),
    ("feed-forward off", "Defaults", "controller: {feed_forward: false}", 1),
    ("disturbance rejection off", "Defaults", "controller: {disturbance_rejection: false}", 1),
    ("drag", "Defaults", "disturbances: {drag: 1.0}", 1),
    (
        "drag, disturbance rejection off",
        "Defaults",
        "{disturbances: {drag: 1.0}, controller: {disturbance_rejection: false}}",
        1,
    ),
    ("wind and drag", "Wind", "", 5),
    (
        "wind and drag, disturbance rejection off",
        "Wind",
        "controller: {disturbance_rejection: false}",
        5,
    ),
    (
        "errors of 10 %, 10 ms delay",
        "Defaults",
        "disturbances: {mass_error: 0.1, inertia_error: 0.1, thrust_coefficient_error: 0.1, "
        "actuator_delay: 0.01}",
        5,
    ),
)
_PHASES = (0.0, 0.25, 0.5, 0.75)  # of the lap
_DRAGS = (0.0, 1.0)
_BATCH = 100  # jobs of a process
_FAILING_ROTOR, _FAILURE_TIMES = 3, (60.0, 120.0)  # number, s


def main(argv=None) -> int:
    """Flies everything and prints the tables; exit code 1 if a race did not finish."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--quick", action="store_true", help="a tenth of the attitudes, one seed, races of one lap"
    )
    parser.add_argument(
        "--only",
        nargs="+",
        choices=list(SECTIONS),
        default=list(SECTIONS),
        help="these sections (default: all)",
    )
    parser.add_argument("--json", type=Path, help="also write what every flight measured")
    parser.add_argument(
        "--workers", type=int, default=os.cpu_count(), help="processes (default: one a processor)"
    )
    args = parser.parse_args(argv)
    jobs = {name: SECTIONS[name](args.quick) for name in SECTIONS if name in args.only}
    flown = run(list(itertools.chain(*jobs.values())), args.workers)
    rows = iter(flown)
    results = {name: list(itertools.islice(rows, len(jobs[name]))) for name in jobs}
    console = Console(width=120)
    for name in jobs:
        for table in TABLES[name](results[name]):
            console.print(table)
    if args.json is not None:
        args.json.write_text(json.dumps(results, indent=1))
    return 0 if all(row.get("finished", True) for row in flown) else 1


def run(jobs: list, workers: int) -> list:
    """Returns what functions return, in their order, called in several processes.

    Args:
        jobs: pairs of a function and its arguments.
        workers: number of processes.
    """
    one_thread_each()
    context = multiprocessing.get_context("spawn")
    # Races take longest, so they go first.
    order = sorted(range(len(jobs)), key=lambda i: jobs[i][0] is not race)
    results = {}
    with Progress(console=Console(stderr=True)) as progress:
        bar = progress.add_task("Flying", total=len(jobs))
        # A flight is never freed, as its Python systems and the diagram hold each
        # other: from time to time, new processes go on.
        for batch in itertools.batched(order, _BATCH * workers):
            with ProcessPoolExecutor(workers, context) as pool:
                futures = {pool.submit(jobs[i][0], *jobs[i][1]): i for i in batch}
                try:
                    for future in as_completed(futures):
                        results[futures[future]] = future.result()
                        progress.advance(bar)
                except BaseException:
                    pool.shutdown(cancel_futures=True)
                    raise
    return [results[i] for i in range(len(jobs))]


def recovery_jobs(quick: bool) -> list:
    """Returns the jobs of run() that recover from attitudes and spins."""
    return [
        (recovery, (drone, noise, index))
        for drone in DRONES
        for noise in _NOISES
        for index in range(20 if quick else 200)
    ]


def tracking_jobs(quick: bool) -> list:
    """Returns the jobs of run() that fly racing laps."""
    return [
        (tracking, (drone, case, noise, name, text, seed))
        for drone in DRONES
        for case, name, text, seeds in _TRACKING_CASES
        for noise in _NOISES
        for seed in range(1 if quick else seeds)
    ]


def wind_jobs(quick: bool) -> list:
    """Returns the jobs of run() that race in the wind."""
    return [(race, (drone, "wind", "Wind", "", 1 if quick else 10)) for drone in DRONES]


def loss_jobs(quick: bool) -> list:
    """Returns the jobs of run() that lose rotors."""
    jobs = []
    for drone, drag in itertools.product(DRONES, _DRAGS):
        rotors = range(1, len(load_vehicle(drone)[0].rotors) + 1)
        phases = _PHASES if drone == "StarOne" else (None, *_PHASES)
        jobs += [(loss, (drone, [r], phase, drag)) for phase in phases for r in rotors]
        if drone == "StarOne":
            pairs = itertools.combinations(rotors, 2)
            jobs += [(loss, (drone, list(pair), None, drag)) for pair in pairs]
    for time in _FAILURE_TIMES:
        text = f"rotor_failures: [{{rotor: {_FAILING_ROTOR}, time: {time}}}]"
        case = f"rotor {_FAILING_ROTOR} fails at {time:.0f} s"
        jobs.append((race, ("StarOne", case, "RotorFailure", text, 1 if quick else 5)))
    return jobs


SECTIONS = {
    "recovery": recovery_jobs,
    "tracking": tracking_jobs,
    "wind": wind_jobs,
    "loss": loss_jobs,
}


if __name__ == "__main__":
    sys.exit(main())
