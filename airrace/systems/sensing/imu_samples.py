"""The layout of the vector in which samples of an IMU cross ports."""

from typing import NamedTuple

import numpy as np

from airrace.common.immutable import read_only
from airrace.common.jit import assign, compilable
from airrace.common.packing import Packing


class ImuSample(NamedTuple):
    """A sample of an IMU.

    It is of the interval from time - T to its time, if T is the period of the sensor; B is the
    body, W the world. Without errors and at the body's origin, the motion goes on by
    R+ = R exp(w T), v+ = v + R f T + g T, p+ = p + v T + (R f + g) T^2 / 2.
    """

    time: float  #: of the end of the interval (s); negative where there is no sample
    #: W, the mean of w_WB in the axes of B (rad/s), (3,): over T, its rotation vector is that of
    #: R_WB(time - T)^T R_WB(time), however the axis moved.
    angular_velocity: np.ndarray
    #: F, the mean of v_WB' - g (m/s^2), (3,), in the axes that B had at time - T.
    specific_force: np.ndarray


_PACKING = Packing(ImuSample, angular_velocity=3, specific_force=3)
as_sample, sample_vector, SAMPLE_SIZE = _PACKING.parts, _PACKING.vector, _PACKING.size
AT_SAMPLE = _PACKING.at

IMU_DEPTH = 10  # samples in a vector, so that a reader may miss some
IMU_SIZE = IMU_DEPTH * SAMPLE_SIZE
NO_SAMPLES = read_only(np.tile([-1.0, *[0.0] * (SAMPLE_SIZE - 1)], IMU_DEPTH))


class ImuSamples(NamedTuple):
    """Samples of an IMU, newest first; see ImuSample."""

    time: np.ndarray  #: n,
    angular_velocity: np.ndarray  #: n, 3
    specific_force: np.ndarray  #: n, 3


def as_samples(vector: np.ndarray) -> ImuSamples:
    """Returns the parts of a vector of n samples, (7 n,), as views of it."""
    rows = vector.reshape((-1, SAMPLE_SIZE))
    return ImuSamples(*(rows[:, at] for at in AT_SAMPLE))


@compilable
def insert(samples: np.ndarray, newest: np.ndarray) -> None:
    """Writes a sample, (7,), in front of others, newest first, (n, 7); the last one falls off."""
    samples[1:] = samples[:-1].copy()
    assign(samples[0], newest)
