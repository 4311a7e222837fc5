"""The part of a scenario that is about the inertial measurement unit (IMU)."""

import dataclasses as dc
import math

from airrace.vehicle import GRAVITY
from airrace.vehicle.imu_errors import ImuErrors

_DEG = math.radians(1.0)
_MG = 1e-3 * GRAVITY  # m/s^2

# What a good chip does on a table. TDK InvenSense ICM-42688-P, datasheet DS-000347: 2.8 mdps and
# 70 ug per sqrt(Hz), +-2000 deg/s and +-16 g, 0.5 deg/s off when it is turned on. 30 mg when it is
# turned on is that chip on a board, soldered and not calibrated. Datasheets say nothing of walks:
# these are the smallest of the preset a2rl.
_BENCH = ImuErrors(
    gyro_noise=2.8e-3 * _DEG,
    gyro_bias=0.5 * _DEG,
    gyro_walk=0.5e-5,
    gyro_range=2000.0 * _DEG,
    accelerometer_noise=0.070 * _MG,
    accelerometer_bias=30.0 * _MG,
    accelerometer_walk=2.0e-4,
    accelerometer_range=16.0 * GRAVITY,
)
PRESETS = {
    "ideal": ImuErrors(),
    "bench": _BENCH,
    # Flown on drones of the Abu Dhabi Autonomous Racing League (A2RL), the greatest of the values
    # that teams published from calibrations with Kalibr, in its units: 1.2 to 1.7e-4, 0.5 to
    # 1.7e-5, 2.7 to 3.5e-3, 2.0 to 2.5e-4. Ranges and turn-on biases as on the bench.
    "a2rl": dc.replace(
        _BENCH,
        gyro_noise=1.7e-4,
        gyro_walk=1.7e-5,
        accelerometer_noise=3.5e-3,
        accelerometer_walk=2.5e-4,
    ),
    # The same chip on the frame of a racing drone, whose vibration is the greatest part of the
    # noise. Our choice, well above all of a2rl. Turn-on biases as on the bench.
    "racing": dc.replace(
        _BENCH,
        gyro_noise=0.05 * _DEG,
        gyro_walk=4e-5,
        accelerometer_noise=2.0 * _MG,
        accelerometer_walk=2e-3,
    ),
    # A cheap one that was never calibrated, on a frame with bent propellers. Our choice: ten
    # and five times the noise of racing, twice its biases.
    "harsh": dc.replace(
        _BENCH,
        gyro_noise=0.5 * _DEG,
        gyro_bias=1.0 * _DEG,
        gyro_walk=4e-5,
        accelerometer_noise=10.0 * _MG,
        accelerometer_bias=50.0 * _MG,
        accelerometer_walk=2e-3,
        scale=0.003,
        axes=0.003,
    ),
}


@dc.dataclass
class ImuErrorsConfig:
    """Takes the place of what the preset says; see ImuErrors."""

    gyro_noise: float | None = None  # rad/s/sqrt(Hz)
    gyro_bias: float | None = None  # rad/s, when it is turned on
    gyro_walk: float | None = None  # rad/s/sqrt(s), of the bias
    gyro_range: float | None = None  # rad/s; .inf for no limit
    accelerometer_noise: float | None = None  # m/s^2/sqrt(Hz)
    accelerometer_bias: float | None = None  # m/s^2, when it is turned on
    accelerometer_walk: float | None = None  # m/s^2/sqrt(s), of the bias
    accelerometer_range: float | None = None  # m/s^2; .inf for no limit
    scale: float | None = None  # share, of each axis
    axes: float | None = None  # rad, by which each axis is off
    latency: float | None = None  # s, from the end of a sample until it can be read
    time_offset: float | None = None  # s, by which its clock is ahead of the camera's


@dc.dataclass
class ImuConfig:
    """The gyroscope and the accelerometer."""

    rate: float = 500.0  # Hz, of the samples
    preset: str = "racing"  # or "ideal", "bench", "a2rl", "harsh"
    errors: ImuErrorsConfig = dc.field(default_factory=ImuErrorsConfig)

    def resolved(self) -> ImuErrors:
        """Returns the preset with what takes its place."""
        given = {k: v for k, v in vars(self.errors).items() if v is not None}
        return dc.replace(PRESETS[self.preset], **given)
