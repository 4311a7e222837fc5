import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from airrace.mavlink import telemetry
from airrace.mavlink.frames import NedState, euler_angles
from airrace.mavlink.telemetry import Clock
from airrace.systems.types import GateCrossing, RefereeStatus
from airrace.track import load_track

TRACK = load_track("grand-prix")
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


@pytest.mark.parametrize("armed", [False, True])
def test_a_heartbeat_says_whether_the_drone_is_armed(armed):
    message = wire(telemetry.heartbeat(armed))
    assert bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED) == armed
    assert message.type == mavlink.MAV_TYPE_QUADROTOR


def test_the_imu_is_in_frd_and_its_pressures_are_no_numbers():
    force, rates = np.array([0.1, 0.2, 9.8]), np.array([0.5, 0.6, 0.7])
    message = wire(telemetry.highres_imu(Clock(1.25), force, rates, inverted=False))
    assert message.time_usec == 1250000
    assert (message.xacc, message.yacc, message.zacc) == pytest.approx((0.1, -0.2, -9.8))
    assert (message.xgyro, message.ygyro, message.zgyro) == pytest.approx((0.5, -0.6, -0.7))
    for name in ("abs_pressure", "diff_pressure", "pressure_alt", "temperature", "xmag"):
        assert math.isnan(getattr(message, name))
    message = wire(telemetry.highres_imu(Clock(1.25), force, rates, inverted=True))
    assert (message.xgyro, message.ygyro, message.zgyro) == pytest.approx((-0.5, -0.6, 0.7))
    assert message.zacc == pytest.approx(-9.8)


def test_actuators_are_four():
    message = wire(telemetry.actuators(Clock(2.0), np.array([0.1, 0.2, 0.3, 0.4])))
    assert message.active == 0b1111 and message.time_usec == 2000000
    assert message.actuator[:5] == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.0])


@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize("wrong", [False, True])
def test_the_pose_and_its_wrong_signs(inverted, wrong):
    roll, pitch, yaw = euler_angles(NED.quaternion)
    rates = [-0.1, 0.2, -0.3] if inverted else [0.1, 0.2, 0.3]
    message = wire(telemetry.attitude(Clock(3.0), NED, inverted, wrong))
    assert message.time_boot_ms == 3000
    angles = (message.roll, message.pitch, message.yaw)
    assert angles == pytest.approx((roll, -pitch if wrong else pitch, yaw), abs=1e-6)
    assert (message.rollspeed, message.pitchspeed, message.yawspeed) == pytest.approx(rates)

    message = wire(telemetry.odometry(Clock(3.0), NED, inverted, wrong))
    assert (message.x, message.y, message.z) == (1.0, 2.0, -3.0)
    assert (message.vx, message.vy, message.vz) == (4.0, 5.0, 6.0)
    assert (message.rollspeed, message.pitchspeed, message.yawspeed) == pytest.approx(rates)
    sign = [1, -1 if wrong else 1, 1, 1]
    np.testing.assert_allclose(message.q, NED.quaternion * sign, atol=1e-6)

    message = wire(telemetry.local_position(Clock(3.0), NED))
    place = message.x, message.y, message.z, message.vx, message.vy, message.vz
    assert place == (1.0, 2.0, -3.0, 4.0, 5.0, 6.0)


@pytest.mark.parametrize("is_gate, number", [(True, 1001), (False, 1002)])
def test_a_collision_names_what_was_hit_and_how_hard(is_gate, number):
    message = wire(telemetry.collision(Clock(1.0), is_gate, 0.75))
    assert message.id == number and message.horizontal_minimum_delta == 0.75


def test_timesync_leaves_the_clients_time_where_it_put_it():
    request = mavlink.MAVLink_timesync_message(123, 0)
    answer = wire(telemetry.timesync(request, Clock(2.0)))
    assert (answer.tc1, answer.ts1) == (123, 2 * 10**9)
    request = mavlink.MAVLink_timesync_message(0, 123)  # as MAVLink's documentation has it
    answer = wire(telemetry.timesync(request, Clock(2.0)))
    assert (answer.tc1, answer.ts1) == (2 * 10**9, 123)


def crossing(gate, time):
    return GateCrossing(gate=gate, lap=1, time=time, offset=0.1, max_speed=3.0)


def test_the_race_status_from_start_to_finish():
    def status(started, *args):
        message = wire(telemetry.race_status(Clock(9.0), started, RefereeStatus(*args), 2))
        return struct.unpack_from("<BQqqIq", bytes(message.data))

    assert status(-1.0, (), False, None, None, 0) == (1, 9000, -1, -1, 0, -1)
    one = (crossing(1, 5.0),)
    assert status(2.0, one, False, None, None, 0) == (1, 9000, 2000, -1, 1, 5 * 10**9)
    both = (crossing(1, 5.0), crossing(2, 7.5))
    end = (1, 9000, 2000, 7_600_000_000, 2, 7_500_000_000)
    assert status(2.0, both, True, None, 7.6, 0) == end


def gates_of(messages):
    """Returns what a client makes of the track's messages."""
    handshake, *packets = map(wire, messages)
    assert handshake.packets == len(packets) and handshake.type == telemetry.TRACK_TYPE
    data = b""
    for i, packet in enumerate(packets):
        body = bytes(packet.data)
        assert body[0] == telemetry.TRACK_TYPE and packet.seqnr == i
        data += body[1 : 1 + handshake.payload]
    data = data[: handshake.size]
    (count,) = struct.unpack_from("<H", data)
    assert len(data) == 2 + 38 * count
    return [struct.unpack_from("<Hfffffffff", data, 2 + 38 * i) for i in range(count)]


def test_the_track_is_put_together_again():
    origin = np.array([1.0, 2.0, 0.5])
    gates = gates_of(telemetry.track_messages(TRACK, origin, hidden=False))
    assert [gate[0] for gate in gates] == list(range(17))
    for numbers, gate in zip(gates, TRACK.gates):
        offset = (gate.p_WG - origin) * [1, -1, -1]
        np.testing.assert_allclose(numbers[1:4], offset, atol=1e-4)
        # The gate's axis of flight, in NED.
        w, x, y, z = numbers[4:8]
        ahead = [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)]
        np.testing.assert_allclose(ahead, gate.forward * [1, -1, -1], atol=1e-5)
        assert numbers[8:] == (1.5, 1.5)


def test_a_hidden_track_says_how_many_gates_there_are():
    gates = gates_of(telemetry.track_messages(TRACK, np.zeros(3), hidden=True))
    assert [gate[0] for gate in gates] == list(range(17))
    assert all(gate[1:] == 9 * (0.0,) for gate in gates)
