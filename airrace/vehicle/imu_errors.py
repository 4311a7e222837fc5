"""What an inertial measurement unit gets wrong, as data."""

import dataclasses as dc
import math

import numpy as np

from airrace.math.random import make_generator


@dc.dataclass(frozen=True)
class ImuErrors:
    """The errors of an inertial measurement unit (IMU); the defaults are none.

    Noise is given as its density, the square root of its power spectral density, as in
    datasheets: of the mean over a time T, it has the standard deviation density / sqrt(T). A
    bias starts anew each time the sensor is turned on and then is a random walk: in a time T it
    moves by a normal number of standard deviation walk sqrt(T). (IEEE Std 952, annex C, calls
    the three angle or velocity random walk, bias and rate random walk.)
    """

    gyro_noise: float = 0.0  #: density (rad/s/sqrt(Hz))
    gyro_bias: float = 0.0  #: standard deviation of the turn-on bias of each axis (rad/s)
    gyro_walk: float = 0.0  #: of the bias (rad/s/sqrt(s))
    gyro_range: float = math.inf  #: the greatest rate that an axis shows (rad/s)
    accelerometer_noise: float = 0.0  #: density (m/s^2/sqrt(Hz))
    accelerometer_bias: float = 0.0  #: standard deviation of the turn-on bias of each axis (m/s^2)
    accelerometer_walk: float = 0.0  #: of the bias (m/s^2/sqrt(s))
    accelerometer_range: float = math.inf  #: the greatest specific force that an axis shows (m/s^2)
    #: Standard deviation of the share by which an axis of either sensor shows too much.
    scale: float = 0.0
    #: Standard deviation of the share of another axis that an axis of either shows; that is, of the
    #: angle between the axis and where it should be (rad).
    axes: float = 0.0
    latency: float = 0.0  #: from the end of a sample until it can be read (s), as whole samples
    #: By which the times that samples say are late, beside those of pictures (s).
    time_offset: float = 0.0


def turn_on_biases(errors: ImuErrors, seed: int) -> np.ndarray:
    """Returns the biases with which a race starts: gyroscope (rad/s), accelerometer, (6,)."""
    sigmas = np.repeat([errors.gyro_bias, errors.accelerometer_bias], 3)
    return sigmas * make_generator(seed, "imu_bias").standard_normal(6)


def axis_matrices(errors: ImuErrors, seed: int) -> np.ndarray:
    """Returns the matrices from true to shown vectors, gyroscope and accelerometer, (2, 3, 3).

    A matrix is I + E: the diagonal of E are errors of scale, the rest of the axes.
    """
    sigmas = np.where(np.eye(3), errors.scale, errors.axes)
    return np.eye(3) + sigmas * make_generator(seed, "imu_axes").standard_normal((2, 3, 3))
