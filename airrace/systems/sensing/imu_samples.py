"""The layout of the vector in which samples of the IMU cross ports."""

from typing import NamedTuple

import numpy as np

from airrace.common.immutable import read_only
from airrace.common.jit import compilable

IMU_DEPTH = 10  # samples in a vector, so that a reader may miss some
IMU_ROW = 7  # numbers of a sample
IMU_SIZE = IMU_DEPTH * IMU_ROW
NO_SAMPLES = read_only(np.tile([-1.0, *[0.0] * (IMU_ROW - 1)], IMU_DEPTH))


class ImuSamples(NamedTuple):
    """Samples of an IMU, newest first.

    A sample is of the interval from time - T to its time, if T is the period of the sensor; B is
    the body, W the world. Without errors and at the body's origin, the motion goes on by
    R+ = R exp(w T), v+ = v + R f T + g T, p+ = p + v T + (R f + g) T^2 / 2.

    Attributes:
        time: of the end of each sample's interval (s), (n,); negative where there is no sample.
        angular_velocity: the mean of w_WB in the axes of B (rad/s), (n, 3): over T, its
            rotation vector is that of R_WB(time - T)^T R_WB(time), however the axis moved.
        specific_force: the mean of v_WB' - g (m/s^2), (n, 3), in the axes that B had at time - T.
    """

    time: np.ndarray
    angular_velocity: np.ndarray
    specific_force: np.ndarray


@compilable
def as_samples(vector: np.ndarray) -> ImuSamples:
    """Returns the parts of a vector of n samples, (7 n,), as views of it."""
    rows = vector.reshape((-1, IMU_ROW))
    return ImuSamples(rows[:, 0], rows[:, 1:4], rows[:, 4:7])


@compilable
def insert(samples: np.ndarray, newest: np.ndarray) -> None:
    """Writes a sample, (7,), in front of others, newest first, (n, 7); the last one falls off."""
    for i in range(len(samples) - 1, 0, -1):
        for j in range(IMU_ROW):
            samples[i, j] = samples[i - 1, j]
    for j in range(IMU_ROW):
        samples[0, j] = newest[j]
