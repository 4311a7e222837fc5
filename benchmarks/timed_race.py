"""How long a race takes, for benchmarks that compare whole races."""

import time

from airrace.diagrams.race import run_race


def time_race(scenario, folder, **options) -> tuple[dict, dict]:
    """Flies a race; times are of it alone, without set-up, report and replay.

    Args:
        scenario: of the race.
        folder: where its results go.
        options: of run_race(), but for ``show``.

    Returns:
        its race.json; and ``simulated_s``, ``wall_s`` and ``cpu_s``.
    """
    looks = []  # the first and the last: simulated, wall and CPU time

    def show(record, look):
        looks[1:] = [(look.time, time.perf_counter(), time.process_time())]

    race = run_race(scenario, folder, show=show, **options)
    return race, {name: b - a for name, a, b in zip(("simulated_s", "wall_s", "cpu_s"), *looks)}
