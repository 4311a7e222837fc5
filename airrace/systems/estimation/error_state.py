"""The error of the nominal state, and how its covariance grows between two pictures.

The error of the drone is (theta, dp, dv, db_g, db_a), (15,), so that the truth is

    R = R_nominal exp(theta),   p = p_nominal + dp,   v, b_g and b_a likewise:

the attitude's error is in axes of the body (Sola 2017, chapter 5, "local"). The errors of the
gates follow, five each, see gate_projection.py. A gate stands still, so that only its correlation
with the drone changes.
"""

from typing import NamedTuple

import numpy as np

from airrace.common.jit import compilable, compiled
from airrace.math.quaternion import turned
from airrace.math.triples import difference, exp_quaternion, rotation_rows, scaled
from airrace.systems.estimation.navigation import Navigation, as_navigation, first_after, move

DRONE = 15  # errors of the drone
# How much the motion may differ from that of the next sample while there is none (sigma).
_MISSED_TURN, _MISSED_ACCELERATION = 2.0, 10.0  # rad/s, m/s^2
THETA, POSITION, VELOCITY, GYRO_BIAS, ACCEL_BIAS = 0, 3, 6, 9, 12  # where each begins


class ImuNoise(NamedTuple):
    """How much the errors of an inertial sensor vary.

    Attributes:
        gyro: density of the angular velocity's white noise (rad/s/sqrt(Hz)).
        accel: of the specific force's (m/s^2/sqrt(Hz)).
        gyro_walk: how fast its bias wanders (rad/s/sqrt(s)).
        accel_walk: (m/s^2/sqrt(s)).
        accel_turn_on: standard deviation of the specific force's bias at the start (m/s^2).
        period: of the sensor (s); a longer time without a sample adds to the noise.
    """

    gyro: float
    accel: float
    gyro_walk: float
    accel_walk: float
    accel_turn_on: float
    period: float = 0.002


@compilable
def corrected(state: Navigation, error: np.ndarray) -> Navigation:
    """Returns the state that a nominal one is, if that has an error, (15,) or longer."""
    return Navigation(
        state.time,
        turned(state.quaternion, error[0:3]),
        state.position + error[3:6],
        state.velocity + error[6:9],
        state.gyro_bias + error[9:12],
        state.accel_bias + error[12:15],
    )


@compilable
def transition(state: Navigation, sample: np.ndarray, dt: float) -> np.ndarray:
    """Returns the derivative of the error after a step by the error before, (15, 15).

    Sola 2017, eq. 269 to 270, with R' = exp(-w dt) for the rotation's transition:
        theta+ = R' theta - dt db_g
        dv+    = dv - dt R [f]x theta - dt R db_a
        dp+    = dp + dt dv - dt^2/2 R [f]x theta - dt^2/2 R db_a

    Args: state: at the beginning. sample, dt: see move().
    """
    w, f = difference(sample[1:4], state.gyro_bias), difference(sample[4:7], state.accel_bias)
    R, back = rotation_rows(state.quaternion), rotation_rows(exp_quaternion(scaled(-dt, w)))
    F = np.eye(DRONE)
    for i in range(3):
        for j in range(3):
            F[THETA + i, THETA + j] = back[i][j]
            # Row i of R, crossed with f: (R [f]x)_ij.
            a, b = (j + 1) % 3, (j + 2) % 3
            turning = R[i][a] * f[b] - R[i][b] * f[a]
            F[VELOCITY + i, THETA + j] = -dt * turning
            F[POSITION + i, THETA + j] = -0.5 * dt * dt * turning
            F[VELOCITY + i, ACCEL_BIAS + j] = -dt * R[i][j]
            F[POSITION + i, ACCEL_BIAS + j] = -0.5 * dt * dt * R[i][j]
        F[THETA + i, GYRO_BIAS + i] = -dt
        F[POSITION + i, VELOCITY + i] = dt
    return F


@compilable
def _times(F, B):
    """Returns F B of a matrix with many zeros, (n, n), and one of (n, m)."""
    result = np.zeros((len(F), B.shape[1]))
    for i in range(len(F)):
        for k in range(len(B)):
            factor = F[i, k]
            if factor != 0.0:
                for j in range(B.shape[1]):
                    result[i, j] += factor * B[k, j]
    return result


@compiled
def propagate(
    vector: np.ndarray, covariance: np.ndarray, history: np.ndarray, time: float, noise: ImuNoise
) -> tuple[np.ndarray, np.ndarray]:
    """Returns nominal state, (17,), and covariance, (n, n), carried forward to a time.

    Args:
        vector: the nominal state before, (17,).
        covariance: of the errors of drone and gates, (n, n).
        history: samples, newest first, (m, 7); see carried_to().
        time: (s).
        noise: of the sensor.
    """
    moved = vector.copy()
    own, total = covariance[:DRONE, :DRONE].copy(), np.eye(DRONE)
    densities = np.zeros(DRONE)
    densities[THETA:POSITION] = noise.gyro**2
    densities[VELOCITY:GYRO_BIAS] = noise.accel**2
    densities[GYRO_BIAS:ACCEL_BIAS] = noise.gyro_walk**2
    densities[ACCEL_BIAS:] = noise.accel_walk**2
    oldest = first_after(history, moved[0])
    for k in range(oldest, -2, -1):  # and the newest once more, up to the time
        sample = history[max(k, 0)]
        until = min(sample[0], time) if k >= 0 else time
        dt = until - moved[0]
        if not dt > 1e-9 or sample[0] <= 0.0:
            continue
        F = transition(as_navigation(moved), sample, dt)
        own = _times(F, _times(F, own).T)
        gap = dt - 1.5 * noise.period
        for i in range(DRONE):
            own[i, i] += dt * densities[i]
            if gap > 0.0 and i < POSITION:
                own[i, i] += (_MISSED_TURN * gap) ** 2
            elif gap > 0.0 and VELOCITY <= i < GYRO_BIAS:
                own[i, i] += (_MISSED_ACCELERATION * gap) ** 2
        total = _times(F, total)
        move(moved, sample, dt)
    result = covariance.copy()
    cross = _times(total, np.ascontiguousarray(covariance[:DRONE, DRONE:]))
    for i in range(DRONE):
        for j in range(DRONE):
            result[i, j] = 0.5 * (own[i, j] + own[j, i])
        for j in range(cross.shape[1]):
            result[i, DRONE + j] = result[DRONE + j, i] = cross[i, j]
    return moved, result
