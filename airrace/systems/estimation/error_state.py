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
from airrace.common.packing import Packing
from airrace.math.quaternion import exp_quaternion, rotation_matrix, turned
from airrace.math.small_matrices import product, skew
from airrace.systems.estimation.navigation import Navigation, as_navigation, move
from airrace.systems.sensing.imu_samples import as_sample


class DroneError(NamedTuple):
    """The error of the drone, in the order of the covariance's rows; or what belongs to each.

    Attributes: a number stands for three equal ones.
        theta: of the attitude, a rotation vector in axes of the body (rad), (3,).
        position: dp (m), (3,).
        velocity: dv (m/s), (3,).
        gyro_bias: db_g (rad/s), (3,).
        accel_bias: db_a (m/s^2), (3,).
    """

    theta: np.ndarray | float
    position: np.ndarray | float
    velocity: np.ndarray | float
    gyro_bias: np.ndarray | float
    accel_bias: np.ndarray | float


_PACKING = Packing(DroneError, theta=3, position=3, velocity=3, gyro_bias=3, accel_bias=3)
as_drone_error, drone_error_vector, DRONE = _PACKING.parts, _PACKING.vector, _PACKING.size
AT = _PACKING.at  # where each begins and ends
# How much the motion may differ from that of the next sample while there is none (sigma).
_MISSED = drone_error_vector(
    DroneError(theta=2.0, position=0.0, velocity=10.0, gyro_bias=0.0, accel_bias=0.0)
)  # rad/s, m/s^2


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
    e = as_drone_error(error)
    return Navigation(
        state.time,
        turned(state.quaternion, e.theta),
        state.position + e.position,
        state.velocity + e.velocity,
        state.gyro_bias + e.gyro_bias,
        state.accel_bias + e.accel_bias,
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
    imu, R = as_sample(sample), rotation_matrix(state.quaternion)
    w, f = imu.angular_velocity - state.gyro_bias, imu.specific_force - state.accel_bias
    turning = product(R, skew(f))
    F = np.eye(DRONE)
    F[AT.theta, AT.theta] = rotation_matrix(exp_quaternion(-dt * w))
    F[AT.theta, AT.gyro_bias] = -dt * np.eye(3)
    F[AT.velocity, AT.theta] = -dt * turning
    F[AT.velocity, AT.accel_bias] = -dt * R
    F[AT.position, AT.velocity] = dt * np.eye(3)
    F[AT.position, AT.theta] = -0.5 * dt * dt * turning
    F[AT.position, AT.accel_bias] = -0.5 * dt * dt * R
    return F


@compiled
def propagate(
    vector: np.ndarray, covariance: np.ndarray, history: np.ndarray, time: float, noise: ImuNoise
) -> tuple[np.ndarray, np.ndarray]:
    """Returns nominal state, (17,), and covariance, (n, n), carried forward to a time.

    Each step adds its noise to F P F^T. The gates stand still, so that their part of P remains,
    and its correlation with the drone is multiplied by the product of all F.

    Args:
        vector: the nominal state before, (17,).
        covariance: of the errors of drone and gates, (n, n).
        history: samples, newest first, (m, 7); see carried_to().
        time: (s).
        noise: of the sensor.
    """
    moved = vector.copy()
    P, total = covariance[:DRONE, :DRONE].copy(), np.eye(DRONE)
    densities = drone_error_vector(
        DroneError(
            theta=noise.gyro**2,
            position=0.0,
            velocity=noise.accel**2,
            gyro_bias=noise.gyro_walk**2,
            accel_bias=noise.accel_walk**2,
        )
    )
    for k in range(len(history) - 1, -2, -1):  # and the newest once more
        sample = history[max(k, 0)]
        until = min(sample[0], time) if k >= 0 else time
        dt = until - moved[0]
        if not dt > 1e-9 or sample[0] <= 0.0:
            continue
        F = transition(as_navigation(moved), sample, dt)
        missed = max(dt - 1.5 * noise.period, 0.0) * _MISSED
        P = product(F, product(F, P).T) + np.diag(dt * densities) + np.diag(missed * missed)
        total = product(F, total)
        move(moved, sample, dt)
    result = covariance.copy()
    result[:DRONE, :DRONE] = 0.5 * (P + P.T)
    result[:DRONE, DRONE:] = product(total, covariance[:DRONE, DRONE:])
    result[DRONE:, :DRONE] = result[:DRONE, DRONE:].T
    return moved, result
