"""The part of a scenario that says what a client of the AI Grand Prix is told, and how."""

import dataclasses as dc

OFFICIAL, NONE = "official", "none"  # dialects, see airrace/mavlink/dialects.py


@dc.dataclass
class QuirksConfig:
    """What a loaded computer does to the stream; all is off by default."""

    imu_drop: float = 0.0  # greatest share of HIGHRES_IMU that load keeps from being sent
    lost_pictures: float = 0.0  # share of pictures that are not sent
    repeated_pictures: float = 0.0  # share of pictures that are the one before once more
    clock_offset: float = 0.0  # s, by which the times on the wire are ahead


@dc.dataclass
class MavlinkConfig:
    """The interface of the AI Grand Prix, see docs/grand_prix.md."""

    vq: int = 2  # virtual qualifier: 1 sends pose and the gates' places, 2 does not
    dialect: str = OFFICIAL  # official: signs and clocks as its clients know them; none: clean NED
    step: bool = False  # wait for one command after every HIGHRES_IMU
    time_limit: float = 480.0  # s, of a race, from its start
    jpeg_quality: int = 97  # of the pictures
    chunk_size: int = 1400  # bytes of a picture in a datagram, at most
    quirks: QuirksConfig = dc.field(default_factory=QuirksConfig)
