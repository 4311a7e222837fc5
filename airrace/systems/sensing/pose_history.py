"""Where a drone was a moment ago, by its state estimates: in machine code, see compiled.py.

A history is an array of state estimates, newest first, (n, 14); where there is none,
the time is -1. See vehicle/state.py for what is in a row.
"""

import math

import numpy as np

from airrace.common.jit import compiled

_TIME, _QUATERNION, _POSITION, _TURNING, _VELOCITY = 0, 1, 5, 8, 11  # where each begins
_SIZE = 14
# No flight leads so far from where the estimate before leads.
_LEAST_JUMP, _MOST_ACCELERATION = 0.2, 50.0  # m and rad; m/s^2 and rad/s^2


@compiled
def remember(history, estimate):
    """Writes a state estimate into a history, if it is sound and newer than what is there.

    Args:
        history: flat, (14 n,).
        estimate: (14,).
    """
    if is_sound(estimate) and estimate[_TIME] > history[_TIME]:
        for k in range(len(history) - 1, _SIZE - 1, -1):
            history[k] = history[k - _SIZE]
        for k in range(_SIZE):
            history[k] = estimate[k]


@compiled
def last_two(history, newest, time):
    """Returns the two newest estimates that are not after a time; (2, 14).

    Args:
        history: flat, (14 n,).
        newest: an estimate that is perhaps not in it yet, (14,).
        time: (s).
    """
    result, count, latest = np.full((2, _SIZE), -1.0), 0, time + 1e-9
    if history[_TIME] < newest[_TIME] <= latest and newest[_TIME] >= 0.0 and is_sound(newest):
        result[0] = newest
        count = 1
    for k in range(0, len(history), _SIZE):
        if count < 2 and 0.0 <= history[k] <= latest:
            result[count] = history[k : k + _SIZE]
            count += 1
    return result


@compiled
def is_sound(estimate):
    """Whether a state estimate is finite and its quaternion one."""
    for number in estimate:
        if not math.isfinite(number):
            return False
    norm = 0.0
    for k in range(4):
        norm += estimate[_QUATERNION + k] ** 2
    return abs(math.sqrt(norm) - 1.0) < 0.1


@compiled
def jumps(before, after):
    """Whether no flight leads from one state estimate to the next, (14,) each."""
    dt = after[_TIME] - before[_TIME]
    expected, actual = moved(before, dt), moved(after, 0.0)
    distance, cosine = 0.0, 0.0  # of half the angle between the attitudes
    for k in range(3):
        distance += (expected[4 + k] - actual[4 + k]) ** 2
    for k in range(4):
        cosine += expected[k] * actual[k]
    limit = _LEAST_JUMP + _MOST_ACCELERATION * dt**2
    turn = 2 * math.acos(min(abs(cosine), 1.0))
    return math.sqrt(distance) > limit or turn > limit


@compiled
def moved(estimate, dt):
    """Returns the pose a short time (s) after a state estimate: unit quaternion and p_WB, (7,)."""
    # The turn until then is 1, b, c, d.
    b = dt * estimate[_TURNING] / 2
    c = dt * estimate[_TURNING + 1] / 2
    d = dt * estimate[_TURNING + 2] / 2
    w, x, y, z = (
        estimate[_QUATERNION],
        estimate[_QUATERNION + 1],
        estimate[_QUATERNION + 2],
        estimate[_QUATERNION + 3],
    )
    pose, norm = np.empty(7), 0.0
    pose[0] = w - b * x - c * y - d * z
    pose[1] = x + b * w + c * z - d * y
    pose[2] = y - b * z + c * w + d * x
    pose[3] = z + b * y - c * x + d * w
    for k in range(4):
        norm += pose[k] ** 2
    for k in range(4):
        pose[k] /= math.sqrt(norm)
    for k in range(3):
        pose[4 + k] = estimate[_POSITION + k] + dt * estimate[_VELOCITY + k]
    return pose
