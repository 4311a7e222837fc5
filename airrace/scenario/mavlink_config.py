"""The part of a scenario that says what a client of the AI Grand Prix is told, and how."""

import dataclasses as dc


@dc.dataclass
class QuirksConfig:
    """Habits of the official simulator's build; all are off by default."""

    doubled_pictures: bool = False  # every datagram of a picture twice
    inverted_rates: bool = False  # roll and yaw rates have the opposite sign of NED's, both ways
    wrong_signs: bool = False  # of ATTITUDE's pitch and ODOMETRY's roll
    imu_drop: float = 0.0  # greatest share of HIGHRES_IMU that load keeps from being sent
    lost_pictures: float = 0.0  # share of pictures that are not sent
    repeated_pictures: float = 0.0  # share of pictures that are the one before once more
    clock_offset: float = 0.0  # s, by which the times on the wire are ahead


# What --quirks official stands for; how much the IMU's rate varies depends on a computer's load.
OFFICIAL = QuirksConfig(doubled_pictures=True, inverted_rates=True, wrong_signs=True, imu_drop=0.3)


@dc.dataclass
class MavlinkConfig:
    """The interface of the AI Grand Prix, see docs/grand_prix.md."""

    vq: int = 2  # virtual qualifier: 1 sends pose and the gates' places, 2 does not
    step: bool = False  # wait for one command after every HIGHRES_IMU
    time_limit: float = 480.0  # s, of a race, from the first arming
    jpeg_quality: int = 85  # of the pictures
    chunk_size: int = 1400  # bytes of a picture in a datagram, at most
    quirks: QuirksConfig = dc.field(default_factory=QuirksConfig)
