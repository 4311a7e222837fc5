"""The flight that every simulator makes, and how it is timed.

This is run by the Python of each simulator's own environment, so it needs numpy
and nothing else.
"""

import json
import math
import os
import time

import numpy as np

RADIUS, HEIGHT, PERIOD = 4.0, 5.0, 5.0  # m, m, s: 5.0 m/s, and 6.3 m/s^2 inwards
# Laps before those that count: the drone settles, and what compiles is compiled. JAX
# does so twice, for the first state and for those that come out of it.
WARM_UP = 2
LAPS = 2  # that count
_RATE = 2.0 * math.pi / PERIOD  # rad/s


def derivatives(time: float) -> np.ndarray:
    """Returns position (m) and its four derivatives on the circle, (5, 3)."""
    c, s = RADIUS * math.cos(_RATE * time), RADIUS * math.sin(_RATE * time)
    w = _RATE
    return np.array(
        [
            [c, s, HEIGHT],
            [-w * s, w * c, 0.0],
            [-(w**2) * c, -(w**2) * s, 0.0],
            [w**3 * s, -(w**3) * c, 0.0],
            [w**4 * c, w**4 * s, 0.0],
        ]
    )


def tracking_rms(times, positions) -> float:
    """Returns the RMS distance (m) of positions (N, 3) from the circle at times (N,), in s."""
    desired = np.array([derivatives(time)[0] for time in times])
    return float(np.sqrt(np.mean(np.sum((np.asarray(positions) - desired) ** 2, axis=1))))


def on_one_core() -> None:
    """Keeps this process, and threads that it starts later, on one core, where that can be."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def timed(fly, *, laps: int = LAPS, **what) -> dict:
    """Flies the laps that count, after those that do not.

    Args:
        fly: start and end of a lap (s) to the times (N,) s and positions (N, 3) m
            that were seen in it; each lap goes on from where the one before ended.
        laps: that count; more than LAPS where two are too short to be timed.
        what: of the row, see report().
    """
    starts = [lap * PERIOD for lap in range(WARM_UP + laps)]
    for start in starts[:WARM_UP]:
        fly(start, start + PERIOD)
    wall, cpu = time.perf_counter(), time.process_time()
    # One by one, because what is compiled may be so for a number of steps.
    flown = [fly(start, start + PERIOD) for start in starts[WARM_UP:]]
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    times, positions = (np.concatenate(part) for part in zip(*flown))
    return {
        **what,
        "simulated_s": laps * PERIOD,
        "wall_s": wall,
        "cpu_s": cpu,
        "rms_m": tracking_rms(times, positions),
    }


def report(simulator: str, rows) -> None:
    """Prints what was measured, as the last line of the output.

    Args:
        simulator: name and version.
        rows: of timed(), with ``controller`` and ``besides``, what else is simulated;
            ``position_hz`` and ``attitude_hz``, the rates of the control loops;
            ``physics_hz``, of its steps, and ``integrator``.
    """
    print(json.dumps({"simulator": simulator, "rows": list(rows)}))
