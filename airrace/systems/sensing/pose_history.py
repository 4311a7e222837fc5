"""Where a drone was a moment ago, by its state estimates.

A history is an array of vectors of State, newest first, (n, 14); where there is none, the
time is -1.
"""

import math

import numpy as np

from airrace.common.jit import all_finite, assign, compilable, compiled
from airrace.math.quaternion import integrate
from airrace.vehicle.state import STATE_SIZE, as_state

# No flight leads so far from where the estimate before leads.
_LEAST_JUMP, _MOST_ACCELERATION = 0.2, 50.0  # m and rad; m/s^2 and rad/s^2


@compiled
def remember(history: np.ndarray, estimate: np.ndarray) -> None:
    """Writes a state estimate into a history, if it is sound and newer than what is there.

    Args:
        history: flat, (14 n,); changed.
        estimate: (14,).
    """
    if is_sound(estimate) and as_state(estimate).time > as_state(history[:STATE_SIZE]).time:
        assign(history, np.concatenate((estimate, history[:-STATE_SIZE])))


@compiled
def last_two(history: np.ndarray, newest: np.ndarray, time: float) -> np.ndarray:
    """Returns the two newest estimates that are not after a time; (2, 14).

    Args:
        history: flat, (14 n,).
        newest: an estimate that is perhaps not in it yet, (14,).
        time: (s).
    """
    result, count, latest = np.full((2, STATE_SIZE), -1.0), 0, time + 1e-9
    rows = history.reshape((-1, STATE_SIZE))
    if is_sound(newest) and as_state(rows[0]).time < as_state(newest).time <= latest:
        result[0], count = newest, 1
    for row in rows:
        if count < 2 and 0.0 <= as_state(row).time <= latest:
            result[count] = row
            count += 1
    return result


@compilable
def is_sound(estimate: np.ndarray) -> bool:
    """Whether a state estimate is finite and its quaternion one."""
    norm = math.sqrt(np.sum(as_state(estimate).quaternion ** 2))
    return all_finite(estimate) and abs(norm - 1.0) < 0.1


@compiled
def jumps(before: np.ndarray, after: np.ndarray) -> bool:
    """Whether no flight leads from one state estimate to the next, (14,) each."""
    dt = as_state(after).time - as_state(before).time
    (q_1, p_1), (q_2, p_2) = moved(before, dt), moved(after, 0.0)
    limit = _LEAST_JUMP + _MOST_ACCELERATION * dt**2
    turn = 2 * math.acos(min(abs(np.dot(q_1, q_2)), 1.0))
    return np.linalg.norm(p_1 - p_2) > limit or turn > limit


@compiled
def moved(estimate: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns the pose a short time (s) after a state estimate: unit quaternion and p_WB."""
    state = as_state(estimate)
    quaternion = integrate(state.quaternion, state.angular_velocity, dt)
    return quaternion, state.position + dt * state.velocity
