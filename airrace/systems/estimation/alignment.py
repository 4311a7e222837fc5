"""Attitude and biases of a drone at rest on its pad, and how certain they are.

At rest an accelerometer shows which way is up, and a gyroscope its bias. What an accelerometer
cannot tell apart is a tilt of the pad and a bias along it: the two errors are fully correlated.
The heading is not observed: the drone's own at the start defines the frame of the map.
"""

import dataclasses as dc
import math
from typing import NamedTuple

import numpy as np

from airrace.math.quaternion import quaternion_product, rotation_between
from airrace.math.small_matrices import product
from airrace.math.vec3 import dot
from airrace.systems.estimation.error_state import (
    AT,
    DRONE,
    DroneError,
    ImuNoise,
    drone_error_vector,
)
from airrace.systems.sensing.imu_samples import as_sample
from airrace.systems.types import Detection
from airrace.vehicle import GRAVITY

_SCALE = 0.02  # m/s^2, of the specific force's length: scale errors of the sensor
_HEADING_SIGMA = 1e-4  # rad
_POSITION_SIGMAS, _VELOCITY_SIGMA = np.array((2e-3, 2e-3, 0.02)), 5e-3  # m, m/s
_STEP = 1e-4  # of the numerical derivative, relative


class Rest(NamedTuple):
    """Means of all samples at rest."""

    samples: int  #: how many
    duration: float  #: of them together (s)
    angular_velocity: np.ndarray  #: mean (rad/s), (3,)
    specific_force: np.ndarray  #: mean (m/s^2), (3,)


NO_REST = Rest(0, 0.0, np.zeros(3), np.array((0.0, 0.0, GRAVITY)))


class Still(NamedTuple):
    """Means of a marker's corners at rest."""

    pictures: int  #: how many
    corners: np.ndarray  #: mean (px), (4, 2)
    variance: float  #: of a coordinate by a picture's noise, mean (px^2)

    def put_into(self, marker: Detection) -> Detection:
        """Returns a marker with the means, and with the noise that these have."""
        sigma = math.sqrt(self.variance / self.pictures)
        return dc.replace(marker, corners=self.corners, corner_sigma=sigma)


NOT_SEEN = Still(0, np.zeros((4, 2)), 0.0)


def averaged(still: Still, marker: Detection) -> Still:
    """Returns the means with the marker of one more picture."""
    n = still.pictures + 1
    return Still(
        n,
        still.corners + (marker.corners - still.corners) / n,
        still.variance + (marker.corner_sigma**2 - still.variance) / n,
    )


def attitude_from(up: np.ndarray, heading: float) -> np.ndarray:
    """Returns the unit quaternion of R_WB of a drone on a pad, (4,).

    The drone stood level with its heading, and then its pad was tilted by the shortest rotation.

    Args: up: any vector upwards, in axes of B, (3,). heading: (rad).
    """
    c, s = math.cos(heading), math.sin(heading)
    length = math.sqrt(dot(up, up))
    # `up` as it would be if the body were turned by the heading alone.
    x, y, z = (c * up[0] - s * up[1]) / length, (s * up[0] + c * up[1]) / length, up[2] / length
    w = math.sqrt(max(0.5 * (1.0 + z), 1e-12))
    tilt = np.array((w, 0.5 * y / w, -0.5 * x / w, 0.0))  # from (x, y, z) to the vertical
    turn = np.array((math.cos(0.5 * heading), 0.0, 0.0, math.sin(0.5 * heading)))
    return quaternion_product(tilt, turn)


def _attitude_by_force(force, heading):
    """Returns the derivative of the attitude's error by the specific force, (3, 3)."""
    q = attitude_from(force, heading)
    result = np.empty((3, 3))
    for j in range(3):
        forward, backward = force.copy(), force.copy()
        forward[j] += _STEP * GRAVITY
        backward[j] -= _STEP * GRAVITY
        a = rotation_between(q, attitude_from(forward, heading))
        b = rotation_between(q, attitude_from(backward, heading))
        result[:, j] = (a - b) / (2.0 * _STEP * GRAVITY)
    return result


def aligned(rest: Rest, heading: float, noise: ImuNoise) -> tuple:
    """Returns what is known of a drone after some time at rest.

    With the mean f of the specific force, and the bias b_a of it, the attitude is that of f - b_a;
    so its error is -J (b_a + n), where J is the derivative of the attitude by the force and n the
    mean of the noise. The length of f tells the bias along it.

    Args: rest: means of its samples. heading: of the drone (rad). noise: of the sensor.

    Returns:
        quaternion, (4,); gyro_bias, (3,); accel_bias, (3,); and the covariance of the drone's
        errors, (15, 15).
    """
    f, duration = rest.specific_force, max(rest.duration, 1e-3)
    length = math.sqrt(dot(f, f))
    up = f / length
    prior, mean_noise = noise.accel_turn_on**2, noise.accel**2 / duration
    along = prior * (mean_noise + _SCALE**2) / (prior + mean_noise + _SCALE**2)
    accel_bias = up * ((length - GRAVITY) * along / (mean_noise + _SCALE**2))
    bias = np.outer(up, up) * (along - prior) + prior * np.eye(3)
    quaternion = attitude_from(f - accel_bias, heading)
    J = _attitude_by_force(f, heading)
    P = np.zeros((DRONE, DRONE))
    # J (bias + mean_noise I) J^T, of which each element is one sum of nine products.
    products = J[:, :, np.newaxis] * (bias + mean_noise * np.eye(3))
    P[AT.theta, AT.theta] = product(products.reshape(3, 9), np.tile(J, 3).T)
    P[AT.theta, AT.accel_bias] = -product(J, bias)
    P[AT.accel_bias, AT.theta] = P[AT.theta, AT.accel_bias].T
    P[AT.accel_bias, AT.accel_bias] = bias
    P += np.diag(
        drone_error_vector(
            DroneError(
                theta=_HEADING_SIGMA**2,
                position=_POSITION_SIGMAS**2,
                velocity=_VELOCITY_SIGMA**2,
                gyro_bias=noise.gyro**2 / duration + 1e-10,
                accel_bias=1e-8,
            )
        )
    )
    return quaternion, rest.angular_velocity, accel_bias, P


def rested(rest: Rest, history: np.ndarray, after: float, until: float) -> Rest:
    """Returns the means with the samples that end after a time and not after another.

    Args: rest: the means before. history: samples, newest first, (n, 7). after, until: (s).
    """
    count, duration = rest.samples, rest.duration
    w, f = rest.angular_velocity.copy(), rest.specific_force.copy()
    time = history[:, 0]
    for sample in history[(time > max(after, 0.0)) & (time <= until)][::-1]:
        _, angular_velocity, specific_force = as_sample(sample)
        count += 1
        w += (angular_velocity - w) / count
        f += (specific_force - f) / count
    return Rest(count, duration + max(until - max(after, 0.0), 0.0), w, f)
