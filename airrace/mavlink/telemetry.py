"""What the simulator sends, from what its ports say: messages, and the datagrams of pictures.

Times are simulated: of the drone's clock, which began with the simulation. Signs, clocks and what
else differs is of a Dialect.
"""

import math
import struct
from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np
from pymavlink.dialects.v20 import common as mavlink
from pymavlink.dialects.v20.common import MAVLink_message as Message

from airrace.math.quaternion import quaternion_product, rotation_matrix
from airrace.mavlink.dialects import LOCAL_NED, Dialect
from airrace.mavlink.frames import NedState, euler_angles, flipped
from airrace.systems.types import RefereeStatus
from airrace.track import Course

GATE_ID, ENVIRONMENT_ID = 1001, 1002  # of COLLISION
_HARD = 1.0  # kg m/s, an impulse from which a collision's threat is high
_DATA_SIZE = 253  # bytes of ENCAPSULATED_DATA
STATUS_TYPE, TRACK_TYPE = 1, 2
_STATUS = struct.Struct("<BQqqIq")
# Of each packet of the track: its type, and the number of the transfer; then a part of the block.
_PACKET, _TRANSFER = struct.Struct("<BH"), 1
_COUNT, _GATE = struct.Struct("<H"), struct.Struct("<Hfffffffff")
# frame_id, chunk_id, total_chunks, jpeg_size, payload_size, sim_time_ns; little-endian.
PICTURE_HEADER = struct.Struct("<IHHIIQ")
_NAN = math.nan
_TO_NED = np.array([0.0, 1.0, 0.0, 0.0])  # half a turn about x: from W to NED
_IMU_FIELDS = 0x3F  # accelerometer and gyroscope
_WORDS = 50  # characters of a STATUSTEXT
_START, _COMMENT, _LARGEST_COMMENT = b"\xff\xd8", b"\xff\xfe", 65533  # of a JPEG


class Clock(NamedTuple):
    """The times on the wire."""

    time: float  # simulated (s)
    offset: float = 0.0  # by which the wire's are ahead (s)
    epoch: int = 0  # time of the boot, on the clock of pictures and TIMESYNC (ns)

    @property
    def ms(self) -> int:
        """Milliseconds since boot, as a field of 32 bits."""
        return max(round(1e3 * (self.time + self.offset)), 0) % 2**32

    @property
    def us(self) -> int:
        """Microseconds."""
        return max(round(1e6 * (self.time + self.offset)), 0)

    @property
    def ns(self) -> int:
        """Nanoseconds since boot."""
        return round(1e9 * (self.time + self.offset))

    @property
    def epoch_ns(self) -> int:
        """Nanoseconds, on the clock of pictures and TIMESYNC."""
        return self.epoch + self.ns


def heartbeat(dialect: Dialect, armed: bool) -> Message:
    """Returns HEARTBEAT."""
    mode, state = dialect.base_mode, mavlink.MAV_STATE_STANDBY
    if armed:
        mode, state = mode | mavlink.MAV_MODE_FLAG_SAFETY_ARMED, dialect.active_status
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_GENERIC, mode, 0, state, 3
    )


def highres_imu(dialect: Dialect, clock: Clock, force: np.ndarray, rates: np.ndarray) -> Message:
    """Returns HIGHRES_IMU; force (m/s^2) and rates (rad/s) are of B, (3,)."""
    return mavlink.MAVLink_highres_imu_message(
        clock.us, *flipped(force), *dialect.gyro * flipped(rates), *7 * [_NAN], _IMU_FIELDS
    )


def actuators(clock: Clock, shares: np.ndarray) -> Message:
    """Returns ACTUATOR_OUTPUT_STATUS; shares: of the motors' greatest thrust, 0 to 1."""
    values = np.zeros(32)
    values[: len(shares)] = shares
    return mavlink.MAVLink_actuator_output_status_message(
        clock.us, 2 ** len(shares) - 1, values.tolist()
    )


def attitude(dialect: Dialect, clock: Clock, ned: NedState) -> Message:
    """Returns ATTITUDE."""
    angles = np.multiply(dialect.attitude, euler_angles(ned.quaternion))
    rates = dialect.attitude_rates * ned.rates
    return mavlink.MAVLink_attitude_message(clock.ms, *angles, *rates)


def local_position(clock: Clock, ned: NedState) -> Message:
    """Returns LOCAL_POSITION_NED."""
    return mavlink.MAVLink_local_position_ned_message(clock.ms, *ned.position, *ned.velocity)


def odometry(dialect: Dialect, clock: Clock, ned: NedState) -> Message:
    """Returns ODOMETRY: what its own quaternion makes of the velocity, is the velocity in NED."""
    unknown = [_NAN] * 21
    quaternion = np.multiply(dialect.odometry_quaternion, ned.quaternion)
    return mavlink.MAVLink_odometry_message(
        clock.us,
        LOCAL_NED,
        dialect.odometry_child,
        *ned.position,
        quaternion.tolist(),
        *rotation_matrix(quaternion).T @ ned.velocity,
        *dialect.odometry_rates * ned.rates,
        unknown,
        unknown,
    )


def collision(clock: Clock, is_gate: bool, impulse: float) -> Message:
    """Returns COLLISION of one sample, whose horizontal_minimum_delta is the impulse (kg m/s)."""
    return mavlink.MAVLink_collision_message(
        mavlink.MAV_COLLISION_SRC_ADSB,
        GATE_ID if is_gate else ENVIRONMENT_ID,
        mavlink.MAV_COLLISION_ACTION_REPORT,
        1 + int(impulse >= _HARD),  # low or high; where the limit is, is ours
        0.0,
        0.0,
        impulse,
    )


def timesync(request: mavlink.MAVLink_timesync_message, clock: Clock) -> Message:
    """Returns the answer: the client's time as ts1, in whichever field it came, ours as tc1."""
    return mavlink.MAVLink_timesync_message(clock.epoch_ns, request.ts1 or request.tc1)


def status_text(number: int, words: str) -> Iterator[Message]:
    """Yields the STATUSTEXTs of a sentence; number: from 1, of the sentence."""
    for i in range(0, len(words), _WORDS):
        part = words[i : i + _WORDS].encode()
        yield mavlink.MAVLink_statustext_message(
            mavlink.MAV_SEVERITY_WARNING, part, number, i // _WORDS
        )


def race_status(clock: Clock, start: float, status: RefereeStatus, gates: int) -> Message:
    """Returns ENCAPSULATED_DATA with the state of the race.

    Args: start: of the race (s), maybe to come, negative before. gates: how many there are.
    """
    passed = len(status.crossings)
    finish = status.end_time if status.finished and status.end_time is not None else None
    data = _STATUS.pack(
        STATUS_TYPE,
        clock.ms,
        clock._replace(time=start).ms if start >= 0.0 else -1,
        -1 if finish is None else clock._replace(time=finish).ns,
        min(passed, gates),
        round(1e9 * (status.crossings[-1].time - start)) if passed else -1,
    )
    return mavlink.MAVLink_encapsulated_data_message(0, _padded(data))


def track_messages(
    dialect: Dialect, track: Course, origin: np.ndarray, hidden: bool
) -> Iterator[Message]:
    """Yields what tells the gates.

    Args:
        track: with the gates. origin: of LOCAL_NED in the world (m), (3,).
        hidden: whether the gates' geometry is zeroed.
    """
    data = _COUNT.pack(len(track.gates))
    for i, gate in enumerate(track.frames()):
        numbers = np.zeros(9)
        if not hidden:
            place = flipped(gate.X_WG @ np.array(dialect.gate_point) - origin)
            q = quaternion_product(
                quaternion_product(_TO_NED, gate.X_WG.rotation().ToQuaternion().wxyz()),
                np.array(dialect.gate_axes),
            )
            numbers = np.hstack([place, q, dialect.gate_side, dialect.gate_side])
        data += _GATE.pack(i, *numbers)
    room = _DATA_SIZE - _PACKET.size
    packets = -(-len(data) // room)
    yield mavlink.MAVLink_data_transmission_handshake_message(
        0, len(data), _TRANSFER, 0, packets, _DATA_SIZE, 1
    )
    for i in range(packets):
        part = _PACKET.pack(TRACK_TYPE, _TRANSFER) + data[i * room : (i + 1) * room]
        yield mavlink.MAVLink_encapsulated_data_message(i, _padded(part))


def encode_picture(picture: np.ndarray, quality: int, size: int = 0) -> bytes:
    """Returns a picture, RGBA (h, w, 4), as JPEG.

    Args:
        quality: from 1 to 100.
        size: of the JPEG, at least (bytes): a smaller one is filled up with comments, which
            decoders skip. Pictures of a real scene are larger than ours.
    """
    bgr = cv2.cvtColor(picture, cv2.COLOR_RGBA2BGR)
    _, jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return _filled_up(jpeg.tobytes(), size)


def _filled_up(jpeg, size):
    while (missing := size - len(jpeg)) > 4:
        length = min(missing - 4, _LARGEST_COMMENT)
        comment = _COMMENT + struct.pack(">H", length + 2) + bytes(length)
        jpeg = _START + comment + jpeg[len(_START) :]
    return jpeg


def picture_datagrams(frame_id: int, time_ns: int, jpeg: bytes, chunk_size: int) -> Iterator[bytes]:
    """Yields the datagrams of a picture.

    Args:
        frame_id: number of the picture. time_ns: when it was taken (ns).
        jpeg: the picture. chunk_size: bytes of it in one datagram, at most.
    """
    total = -(-len(jpeg) // chunk_size)
    for i in range(total):
        part = jpeg[i * chunk_size : (i + 1) * chunk_size]
        header = PICTURE_HEADER.pack(
            frame_id % 2**32, i, total, len(jpeg), len(part), max(time_ns, 0) % 2**64
        )
        yield header + part


def _padded(data: bytes) -> list[int]:
    return list(data.ljust(_DATA_SIZE, b"\0"))
