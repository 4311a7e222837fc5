"""The nominal state of the estimator, and strapdown integration of inertial samples.

"Strapdown" is a sensor that is fixed to the body, in contrast to one on a gimbal. The point that
is carried forward is the sensor's, I, whose axes are those of the body; the body's origin follows
from where the sensor is mounted.
"""

from typing import NamedTuple

import numpy as np

from airrace.common.jit import assign, compilable, compiled
from airrace.common.packing import Packing
from airrace.math.triples import cross, difference, rotate, rotation_rows, scaled, turned
from airrace.systems.sensing.imu_samples import as_sample, insert
from airrace.vehicle.free_body import at_constant_acceleration, linear_acceleration
from airrace.vehicle.state import as_state


class Navigation(NamedTuple):
    """Time, pose, velocity and biases of the inertial sensor."""

    time: float  #: (s); negative before anything is known
    quaternion: np.ndarray  #: of R_WB, [w, x, y, z], (4,)
    position: np.ndarray  #: p_WI (m), (3,)
    velocity: np.ndarray  #: v_WI (m/s), (3,)
    gyro_bias: np.ndarray  #: of the angular velocity (rad/s), (3,)
    accel_bias: np.ndarray  #: of the specific force (m/s^2), (3,)


_PACKING = Packing(Navigation, quaternion=4, position=3, velocity=3, gyro_bias=3, accel_bias=3)
as_navigation, navigation_vector, NAVIGATION_SIZE = _PACKING.parts, _PACKING.vector, _PACKING.size


@compilable
def move(vector: np.ndarray, sample: np.ndarray, dt: float) -> None:
    """Carries a nominal state, (17,), on by a time at the mean rates of a sample.

    With the angular velocity w and the specific force f, less their biases,
        R+ = R exp(w dt),  v+ = v + (R f + g) dt,  p+ = p + v dt + (R f + g) dt^2 / 2.

    Args:
        vector: at the beginning; is changed.
        sample: time, w and f, (7,); f in the axes of the beginning.
        dt: (s).
    """
    _, q, p, v, gyro_bias, accel_bias = as_navigation(vector)
    _, angular_velocity, specific_force = as_sample(sample)
    w, f = difference(angular_velocity, gyro_bias), difference(specific_force, accel_bias)
    a = linear_acceleration(rotation_rows(q), f)
    vector[0] += dt
    assign(q, turned(q, scaled(dt, w)))
    p_after, v_after = at_constant_acceleration(p, v, a, dt)
    assign(p, p_after)
    assign(v, v_after)


@compiled
def carried_to(vector: np.ndarray, history: np.ndarray, time: float) -> np.ndarray:
    """Returns a nominal state, (17,), carried forward to a time (s) by the samples since.

    A sample counts from the end of the one before it, so that one that was lost is bridged; the
    newest one counts to the time if that is later.

    Args:
        vector: the state before.
        history: samples, newest first, (n, 7); where there is none, the time is negative.
        time: (s).
    """
    result = vector.copy()
    for sample in history[::-1]:
        dt = min(sample[0], time) - result[0]
        if dt > 0.0 and sample[0] > 0.0:
            move(result, sample, dt)
    if time > result[0] and history[0, 0] > 0.0:
        move(result, history[0], time - result[0])
    return result


@compilable
def write_state(
    result: np.ndarray, state: Navigation, angular_velocity: np.ndarray, p_BI: np.ndarray
) -> None:
    """Writes a vector of vehicle/state.py, (14,), of the body's origin.

    Args:
        result: to be written.
        state: of the sensor.
        angular_velocity: w_WB less its bias, in axes of B (rad/s), (3,).
        p_BI: where the sensor is mounted (m), (3,).
    """
    R = rotation_rows(state.quaternion)
    w, r = rotate(R, angular_velocity), rotate(R, p_BI)
    result[0] = state.time
    body = as_state(result)
    assign(body.quaternion, state.quaternion)
    assign(body.position, difference(state.position, r))
    assign(body.angular_velocity, w)
    assign(body.velocity, difference(state.velocity, cross(w, r)))


@compiled
def remember(history: np.ndarray, samples: np.ndarray, ranges: np.ndarray) -> int:
    """Writes the samples that are new and sound into a history; returns how many were.

    Sound is what is finite and within the sensor's ranges.

    Args:
        history: samples, newest first, (n, 7); changed.
        samples: of the sensor, newest first, (m, 7).
        ranges: of the angular velocity (rad/s) and the specific force (m/s^2), (6,).
    """
    count = 0
    for sample in samples[::-1]:
        is_new = sample[0] > history[0, 0] and sample[0] > 0.0
        if is_new and np.all(np.abs(sample[1:]) < ranges):  # NaN is not
            insert(history, sample)
            count += 1
    return count
