import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from airrace.math.quaternion import rotation_matrix
from airrace.mavlink import telemetry
from airrace.mavlink.dialects import DIALECTS
from airrace.mavlink.frames import NedState, euler_angles
from airrace.mavlink.telemetry import Clock
from airrace.systems.types import GateCrossing, RefereeStatus
from airrace.track import load_track
from airrace.track.square_track import SquareTrack

TRACK = load_track("grand-prix")
OFFICIAL, CLEAN = DIALECTS["official"], DIALECTS["none"]
each = pytest.mark.parametrize("dialect", DIALECTS)
NED = NedState(
    np.array([1.0, 2.0, -3.0]),
    np.array([4.0, 5.0, 6.0]),
    np.array([0.9, 0.1, 0.2, 0.3]) / np.linalg.norm([0.9, 0.1, 0.2, 0.3]),
    np.array([0.1, 0.2, 0.3]),
)


def wire(message):
    """Returns the message as a client decodes it."""
    data = message.pack(mavlink.MAVLink(None))
    assert data[0] == 0xFD  # MAVLink 2
    (decoded,) = mavlink.MAVLink(None).parse_buffer(data)
    return decoded


@given(st.floats(0.0, 4e5), st.floats(-1e3, 1e3))
def test_clocks_agree(time, offset):
    clock = Clock(time, offset)
    assert clock.ms == pytest.approx(max(1e3 * (time + offset), 0.0), abs=0.51)
    assert clock.us == pytest.approx(max(1e6 * (time + offset), 0.0), abs=0.51)
    assert clock.ns == pytest.approx(1e9 * (time + offset), abs=1e3)


@each
@pytest.mark.parametrize("armed", [False, True])
def test_a_heartbeat_says_whether_the_drone_is_armed(dialect, armed):
    message = wire(telemetry.heartbeat(DIALECTS[dialect], armed))
    assert bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED) == armed
    assert (message.type, message.autopilot) == (mavlink.MAV_TYPE_QUADROTOR, 0)


def test_the_official_heartbeat_is_the_captured_one():
    heartbeats = [wire(telemetry.heartbeat(OFFICIAL, armed)) for armed in (False, True)]
    assert [(m.base_mode, m.system_status) for m in heartbeats] == [(65, 3), (193, 3)]


def test_the_imu_is_in_frd_and_its_pressures_are_no_numbers():
    force, rates = np.array([0.1, 0.2, 9.8]), np.array([0.5, 0.6, 0.7])
    message = wire(telemetry.highres_imu(CLEAN, Clock(1.25), force, rates))
    assert message.time_usec == 1250000 and message.fields_updated == 0x3F
    assert (message.xacc, message.yacc, message.zacc) == pytest.approx((0.1, -0.2, -9.8))
    assert (message.xgyro, message.ygyro, message.zgyro) == pytest.approx((0.5, -0.6, -0.7))
    for name in ("abs_pressure", "diff_pressure", "pressure_alt", "temperature", "xmag"):
        assert math.isnan(getattr(message, name))
    message = wire(telemetry.highres_imu(OFFICIAL, Clock(1.25), force, rates))
    assert (message.xgyro, message.ygyro, message.zgyro) == pytest.approx((-0.5, 0.6, 0.7))
    assert (message.xacc, message.yacc, message.zacc) == pytest.approx((0.1, -0.2, -9.8))


def test_actuators_are_four():
    message = wire(telemetry.actuators(Clock(2.0), np.array([0.1, 0.2, 0.3, 0.4])))
    assert message.active == 0b1111 and message.time_usec == 2000000
    assert message.actuator[:5] == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.0])


@pytest.mark.parametrize(
    "dialect, angles, sign, quaternion, child",
    [("official", [1, -1, -1], -1, [1, -1, 1, -1], 8), ("none", [1, 1, 1], 1, [1, 1, 1, 1], 12)],
)
def test_the_pose_has_the_signs_of_its_dialect(dialect, angles, sign, quaternion, child):
    dialect, clock = DIALECTS[dialect], Clock(3.0)
    message = wire(telemetry.attitude(dialect, clock, NED))
    assert message.time_boot_ms == 3000
    expected = np.multiply(angles, euler_angles(NED.quaternion))
    np.testing.assert_allclose([message.roll, message.pitch, message.yaw], expected, atol=1e-6)
    rates = [message.rollspeed, message.pitchspeed, message.yawspeed]
    np.testing.assert_allclose(rates, sign * NED.rates, atol=1e-6)

    message = wire(telemetry.odometry(dialect, clock, NED))
    assert (message.x, message.y, message.z) == (1.0, 2.0, -3.0)
    # Its own quaternion turns its velocity to NED's, in both.
    v = [message.vx, message.vy, message.vz]
    turned = rotation_matrix(np.array(message.q) / np.linalg.norm(message.q)) @ v
    np.testing.assert_allclose(turned, NED.velocity, atol=1e-5)
    assert (message.frame_id, message.child_frame_id) == (1, child)
    rates = [message.rollspeed, message.pitchspeed, message.yawspeed]
    np.testing.assert_allclose(rates, sign * NED.rates, atol=1e-6)
    np.testing.assert_allclose(message.q, NED.quaternion * quaternion, atol=1e-6)

    message = wire(telemetry.local_position(clock, NED))
    place = message.x, message.y, message.z, message.vx, message.vy, message.vz
    assert place == (1.0, 2.0, -3.0, 4.0, 5.0, 6.0)


@pytest.mark.parametrize("is_gate, number", [(True, 1001), (False, 1002)])
def test_a_collision_names_what_was_hit_and_how_hard(is_gate, number):
    message = wire(telemetry.collision(Clock(1.0), is_gate, 0.75))
    assert message.id == number and message.horizontal_minimum_delta == 0.75


def test_a_collision_is_a_threat_by_its_impulse():
    threats = [wire(telemetry.collision(Clock(1.0), True, i)).threat_level for i in (0.2, 3.0)]
    assert threats == [1, 2]


@pytest.mark.parametrize("sent", [(123, 0), (0, 123)])
def test_timesync_gives_the_clients_time_back_as_ts1(sent):
    answer = wire(telemetry.timesync(mavlink.MAVLink_timesync_message(*sent), Clock(2.0, 0.0, 7)))
    assert (answer.tc1, answer.ts1) == (2 * 10**9 + 7, 123)


def test_a_long_sentence_is_said_in_parts():
    sentence = "a sentence of more than fifty letters, which is the most of one STATUSTEXT"
    parts = [wire(message) for message in telemetry.status_text(3, sentence)]
    assert "".join(part.text for part in parts) == sentence
    assert [(part.id, part.chunk_seq) for part in parts] == [(3, 0), (3, 1)]


def crossing(gate, time):
    return GateCrossing(gate=gate, lap=1, time=time, offset=0.1, max_speed=3.0)


def test_the_race_status_from_start_to_finish():
    def status(start, *args):
        message = wire(telemetry.race_status(Clock(9.0), start, RefereeStatus(*args), 2))
        return struct.unpack_from("<BQqqIq", bytes(message.data))

    assert status(-1.0, (), False, None, None, 0) == (1, 9000, -1, -1, 0, -1)
    assert status(11.5, (), False, None, None, 0) == (1, 9000, 11500, -1, 0, -1)  # a countdown
    one = (crossing(1, 5.0),)
    assert status(2.0, one, False, None, None, 0) == (1, 9000, 2000, -1, 1, 3 * 10**9)
    both = (crossing(1, 5.0), crossing(2, 7.5))
    end = (1, 9000, 2000, 7_600_000_000, 2, 5_500_000_000)
    assert status(2.0, both, True, None, 7.6, 0) == end


def gates_of(messages):
    """Returns what a client makes of the track's messages."""
    handshake, *packets = map(wire, messages)
    assert handshake.packets == len(packets) and handshake.payload == 253
    assert (handshake.type, handshake.jpg_quality) == (0, 1)
    data = b""
    for i, packet in enumerate(packets):
        body = bytes(packet.data)
        assert struct.unpack_from("<BH", body) == (2, handshake.width) and packet.seqnr == i
        data += body[3:]
    data = data[: handshake.size]
    (count,) = struct.unpack_from("<H", data)
    assert len(data) == 2 + 38 * count
    return [struct.unpack_from("<Hfffffffff", data, 2 + 38 * i) for i in range(count)]


@each
def test_the_track_is_put_together_again(dialect):
    origin = np.array([1.0, 2.0, 0.5])
    gates = gates_of(telemetry.track_messages(DIALECTS[dialect], TRACK, origin, hidden=False))
    assert [gate[0] for gate in gates] == list(range(17))
    for numbers, gate in zip(gates, TRACK.gates):
        middle = (gate.p_WG - origin) * [1, -1, -1]
        R = rotation_matrix(np.array(numbers[4:8]))
        ahead, right = gate.forward * [1, -1, -1], gate.rightward * [1, -1, -1]
        if dialect == "official":
            # The middle of its lower edge, 1.36 m below; x along the width, y the normal.
            up = np.cross(ahead, right) * -1.0
            np.testing.assert_allclose(numbers[1:4], middle - 1.36 * up, atol=1e-4)
            np.testing.assert_allclose(R[:, :2].T, [-right, ahead], atol=1e-5)
        else:
            np.testing.assert_allclose(numbers[1:4], middle, atol=1e-4)
            np.testing.assert_allclose(R[:, :2].T, [ahead, right], atol=1e-5)
        side = np.float32(2.72 if dialect == "official" else 1.5)
        assert numbers[8:] == (side, side)


def test_a_hidden_track_says_how_many_gates_there_are():
    gates = gates_of(telemetry.track_messages(OFFICIAL, TRACK, np.zeros(3), hidden=True))
    assert [gate[0] for gate in gates] == list(range(17))
    assert all(gate[1:] == 9 * (0.0,) for gate in gates)


def test_six_gates_take_as_many_bytes_as_were_captured():
    six = SquareTrack("six", gates=TRACK.gates[:6])
    handshake, *_ = telemetry.track_messages(OFFICIAL, six, np.zeros(3), hidden=False)
    assert handshake.size == 230 and handshake.packets == 1
