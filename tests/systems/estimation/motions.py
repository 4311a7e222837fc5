"""Synthetic motions, samples and sights for tests of the estimator."""

import numpy as np
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RotationMatrix

from airrace.math.quaternion import exp_quaternion
from airrace.systems.estimation.error_state import DRONE, ImuNoise
from airrace.systems.estimation.gate_projection import Camera
from airrace.systems.estimation.navigation import Navigation, as_navigation, move, navigation_vector
from airrace.vehicle import GRAVITY_W
from airrace.vehicle.camera_info import make_camera_info

PERIOD = 0.002  # s
NOISE = ImuNoise(8.7e-4, 0.02, 4e-5, 2e-3, 0.3)
R_BC = RotationMatrix(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]))
INFO = make_camera_info(
    width=1280, height=720, fov_y=np.deg2rad(55.95), X_BC=RigidTransform(R_BC, [0.1, 0.0, 0.05])
)
CAMERA = Camera(
    np.array([*INFO.K[[0, 1, 0, 1], [0, 1, 2, 2]], *INFO.D]),
    np.ascontiguousarray(R_BC.matrix().T),
    INFO.X_BC.translation(),
)

vectors = st.tuples(*3 * [st.floats(-1.0, 1.0)]).map(np.array)


def navigation(turn=(0.0, 0.0, 0.0), p=(0.0, 0.0, 5.0), v=(0.0, 0.0, 0.0), time=1.0):
    """Returns the vector of a Navigation without biases."""
    q = exp_quaternion(np.array(turn, float))
    return navigation_vector(
        Navigation(time, q, np.array(p, float), np.array(v, float), np.zeros(3), np.zeros(3))
    )


def moved_by(state, sample, dt):
    """Returns the Navigation that move() makes of one."""
    vector = navigation_vector(state)
    move(vector, sample, dt)
    return as_navigation(vector)


def as_history(samples):
    """Returns samples, oldest first, as the history that a filter reads."""
    return np.ascontiguousarray(np.array(samples)[::-1])


def true_sample(time, w, acceleration, R):
    """Returns the ideal sample of an angular velocity (in B) and an acceleration (in W)."""
    return np.array([time, *w, *(R.T @ (acceleration - GRAVITY_W))])


def numerical(function, size, step=1e-6):
    """Returns the derivative of a function of a vector at zero, by central differences."""
    columns = [(function(e) - function(-e)) / (2 * step) for e in step * np.eye(size)]
    return np.column_stack(columns)


def drone_covariance(theta=0.01, p=0.05, v=0.05, gyro=1e-3, accel=0.02):
    """Returns a diagonal covariance of the drone's errors of these standard deviations."""
    P = np.zeros((DRONE, DRONE))
    P[range(DRONE), range(DRONE)] = np.repeat([theta, p, v, gyro, accel], 3) ** 2
    return P
