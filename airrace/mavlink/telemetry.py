"""What the simulator sends, from what its ports say: messages, and the datagrams of pictures.

Times are simulated: of the drone's clock, which began with the simulation.
"""

import math
import struct
from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np
from pymavlink.dialects.v20 import common as mavlink
from pymavlink.dialects.v20.common import MAVLink_message as Message

from airrace.mavlink.commands import signed_rates
from airrace.mavlink.frames import NedState, euler_angles, flipped, flipped_quaternion
from airrace.systems.types import RefereeStatus
from airrace.track import Course
from airrace.track.square_gate import INNER

GATE_ID, ENVIRONMENT_ID = 1001, 1002  # of COLLISION
_DATA_SIZE = 253  # bytes of ENCAPSULATED_DATA
STATUS_TYPE, TRACK_TYPE = 1, 2
_STATUS = struct.Struct("<BQqqIq")
_COUNT, _GATE = struct.Struct("<H"), struct.Struct("<Hfffffffff")
# frame_id, chunk_id, total_chunks, jpeg_size, payload_size, sim_time_ns; little-endian.
PICTURE_HEADER = struct.Struct("<IHHIIQ")
_NAN = math.nan
_IMU_FIELDS = 0x3F  # accelerometer and gyroscope


class Clock(NamedTuple):
    """The times on the wire."""

    time: float  # simulated (s)
    offset: float = 0.0  # by which the wire's are ahead (s)

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
        """Nanoseconds."""
        return round(1e9 * (self.time + self.offset))


def heartbeat(armed: bool) -> Message:
    """Returns HEARTBEAT."""
    mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
    state = mavlink.MAV_STATE_STANDBY
    if armed:
        mode |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        state = mavlink.MAV_STATE_ACTIVE
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_GENERIC, mode, 0, state, 3
    )


def highres_imu(clock: Clock, force: np.ndarray, rates: np.ndarray, inverted: bool) -> Message:
    """Returns HIGHRES_IMU; force (m/s^2) and rates (rad/s) are of B, (3,)."""
    rates = signed_rates(flipped(rates), inverted)
    return mavlink.MAVLink_highres_imu_message(
        clock.us, *flipped(force), *rates, *7 * [_NAN], _IMU_FIELDS
    )


def actuators(clock: Clock, shares: np.ndarray) -> Message:
    """Returns ACTUATOR_OUTPUT_STATUS; shares: of each rotor's greatest thrust, 0 to 1."""
    values = np.zeros(32)
    values[: len(shares)] = shares
    return mavlink.MAVLink_actuator_output_status_message(
        clock.us, 2 ** len(shares) - 1, values.tolist()
    )


def attitude(clock: Clock, ned: NedState, inverted: bool, wrong: bool) -> Message:
    """Returns ATTITUDE; wrong: whether the pitch has the wrong sign."""
    roll, pitch, yaw = euler_angles(ned.quaternion)
    rates = signed_rates(ned.rates, inverted)
    return mavlink.MAVLink_attitude_message(clock.ms, roll, -pitch if wrong else pitch, yaw, *rates)


def local_position(clock: Clock, ned: NedState) -> Message:
    """Returns LOCAL_POSITION_NED."""
    return mavlink.MAVLink_local_position_ned_message(clock.ms, *ned.position, *ned.velocity)


def odometry(clock: Clock, ned: NedState, inverted: bool, wrong: bool) -> Message:
    """Returns ODOMETRY, with the velocity in NED; wrong: whether the roll has the wrong sign."""
    q = ned.quaternion * [1.0, -1.0, 1.0, 1.0] if wrong else ned.quaternion
    unknown = [_NAN] * 21
    return mavlink.MAVLink_odometry_message(
        clock.us,
        mavlink.MAV_FRAME_LOCAL_NED,
        mavlink.MAV_FRAME_LOCAL_NED,
        *ned.position,
        q.tolist(),
        *ned.velocity,
        *signed_rates(ned.rates, inverted),
        unknown,
        unknown,
    )


def collision(clock: Clock, is_gate: bool, impulse: float) -> Message:
    """Returns COLLISION, whose horizontal_minimum_delta is the impulse (kg m/s)."""
    return mavlink.MAVLink_collision_message(
        mavlink.MAV_COLLISION_SRC_ADSB,
        GATE_ID if is_gate else ENVIRONMENT_ID,
        mavlink.MAV_COLLISION_ACTION_REPORT,
        mavlink.MAV_COLLISION_THREAT_LEVEL_HIGH,
        0.0,
        0.0,
        impulse,
    )


def timesync(request: mavlink.MAVLink_timesync_message, clock: Clock) -> Message:
    """Returns the answer: the client's time where it put it, the drone's in the other field."""
    if request.tc1 == 0:  # as MAVLink's documentation has it
        return mavlink.MAVLink_timesync_message(clock.ns, request.ts1)
    return mavlink.MAVLink_timesync_message(request.tc1, clock.ns)


def race_status(clock: Clock, started: float, status: RefereeStatus, gates: int) -> Message:
    """Returns ENCAPSULATED_DATA with the state of the race.

    Args: started: when the drone was first armed (s), negative before. gates: how many there are.
    """

    def ns(time: float) -> int:
        return Clock(time, clock.offset).ns

    passed = len(status.crossings)
    finish = status.end_time if status.finished and status.end_time is not None else None
    data = _STATUS.pack(
        STATUS_TYPE,
        clock.ms,
        Clock(started, clock.offset).ms if started >= 0.0 else -1,
        -1 if finish is None else ns(finish),
        min(passed, gates),
        ns(status.crossings[-1].time) if passed else -1,
    )
    return mavlink.MAVLink_encapsulated_data_message(0, _padded(data))


def track_messages(track: Course, origin: np.ndarray, hidden: bool) -> Iterator:
    """Yields DATA_TRANSMISSION_HANDSHAKE, and the track in as many ENCAPSULATED_DATA as it takes.

    Args:
        track: of the race. origin: of LOCAL_NED in the world (m), (3,).
        hidden: whether the gates' geometry is zeroed.
    """
    data = _COUNT.pack(len(track.gates))
    for i, gate in enumerate(track.frames()):
        numbers = np.zeros(9)
        if not hidden:
            q = gate.X_WG.rotation().ToQuaternion().wxyz()
            place = flipped(gate.p_WG - origin)
            numbers = np.hstack([place, flipped_quaternion(q), INNER, INNER])
        data += _GATE.pack(i, *numbers)
    # The first byte of each message says what it is.
    room = _DATA_SIZE - 1
    packets = -(-len(data) // room)
    yield mavlink.MAVLink_data_transmission_handshake_message(
        TRACK_TYPE, len(data), 0, 0, packets, room, 0
    )
    for i in range(packets):
        part = bytes([TRACK_TYPE]) + data[i * room : (i + 1) * room]
        yield mavlink.MAVLink_encapsulated_data_message(i, _padded(part))


def encode_picture(picture: np.ndarray, quality: int) -> bytes:
    """Returns a picture, RGBA (h, w, 4), as JPEG of a quality from 1 to 100."""
    bgr = cv2.cvtColor(picture, cv2.COLOR_RGBA2BGR)
    _, jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return jpeg.tobytes()


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
