"""The bridge in the whole simulation, without a network; its client is an Earpiece."""

import struct

import cv2
import numpy as np
import pytest
from pydrake.math import RollPitchYaw
from pymavlink.dialects.v20 import common as mavlink

from airrace.mavlink import bridge
from airrace.mavlink.commands import setpoint_of
from airrace.mavlink.telemetry import PICTURE_HEADER
from airrace.systems.control.setpoint import as_setpoint
from airrace.track.square_gate import INNER, OUTER
from tests.worlds.mavlink_client import (
    Earpiece,
    Session,
    arm,
    attitude,
    command,
    grand_prix,
    motors,
    position,
    rates,
    velocity,
)

SECONDS = 5.0
# Hz, of simulated time.
RATES = {
    "HEARTBEAT": 10,
    "HIGHRES_IMU": 62,
    "ACTUATOR_OUTPUT_STATUS": 96,
    "ATTITUDE": 114,
    "LOCAL_POSITION_NED": 93,
    "ODOMETRY": 72,
}
POSE = ("ATTITUDE", "LOCAL_POSITION_NED", "ODOMETRY")


def race_status(message):
    """Returns type, boot ms, start ms, finish ns, gate, and time of the last gate ns."""
    return struct.unpack_from("<BQqqIq", bytes(message.data))


def statuses(link):
    found = [each for each in link.of("ENCAPSULATED_DATA") if each.data[0] == 1]
    return [race_status(each) for each in found]


def pictures(link):
    """Returns the frames of a stream: their headers, and the pictures."""
    frames = {}
    for datagram in link.pictures:
        header = PICTURE_HEADER.unpack(datagram[:24])
        frames.setdefault(header[0], []).append((header, datagram[24:]))
    return frames


@pytest.fixture(scope="module")
def flown():
    """VQ1: two seconds on the pad, then armed, and a climb at 1 m/s for three."""
    session = Session(grand_prix(vq=1))
    session.fly(2.0)
    session.link.say(arm())
    session.fly(SECONDS - 2.0, velocity(0.0, 0.0, -1.0))
    return session


def test_every_message_has_its_rate(flown):
    for kind, rate in RATES.items():
        count = len(flown.link.of(kind))
        # The first one may be sent at once.
        assert count == pytest.approx(rate * SECONDS, rel=0.02, abs=1.0), kind
    assert len(statuses(flown.link)) == pytest.approx(4 * SECONDS, abs=1)
    assert len(pictures(flown.link)) == pytest.approx(30 * SECONDS, abs=1)
    assert len(flown.link.of("DATA_TRANSMISSION_HANDSHAKE")) == pytest.approx(SECONDS, abs=1)


def test_times_on_the_wire_are_simulated_and_even(flown):
    times = np.array([m.time_usec for m in flown.link.of("HIGHRES_IMU")]) / 1e6
    np.testing.assert_allclose(np.diff(times), 1 / 62, atol=2e-6)
    assert times[-1] == pytest.approx(SECONDS, abs=0.02)
    times = np.array([m.time_boot_ms for m in flown.link.of("ATTITUDE")])
    assert np.diff(times).max() <= 10
    stamps = [parts[0][0][5] / 1e9 for parts in pictures(flown.link).values()]
    np.testing.assert_allclose(np.diff(stamps), 1 / 30, atol=1e-6)


def test_heartbeats_say_since_when_it_is_armed(flown):
    armed = [bool(m.base_mode & 128) for m in flown.link.of("HEARTBEAT")]
    assert armed.index(True) == pytest.approx(20, abs=1)
    assert all(armed[armed.index(True) :])


def test_on_its_pad_the_drone_looks_down_by_the_pads_tilt(flown):
    still = flown.link.of("HIGHRES_IMU")[60]
    tilt = np.deg2rad(17.8)
    # Nose-down, what carries the drone pushes backwards and up.
    force = np.array([still.xacc, still.yacc, still.zacc])
    np.testing.assert_allclose(force, [-9.81 * np.sin(tilt), 0, -9.81 * np.cos(tilt)], atol=0.1)
    first = flown.link.of("ATTITUDE")[100]
    assert first.pitch == pytest.approx(-tilt, abs=0.02) and first.roll == pytest.approx(
        0, abs=0.02
    )
    heading = -np.deg2rad(flown.bridge._track.start.heading_deg)
    assert np.cos(first.yaw - heading) == pytest.approx(1.0, abs=1e-3)


def test_local_ned_begins_on_the_pad(flown):
    places = [(m.x, m.y, m.z) for m in flown.link.of("LOCAL_POSITION_NED")]
    np.testing.assert_allclose(places[round(93 * 1.9)], 0.0, atol=0.02)
    last = flown.link.of("LOCAL_POSITION_NED")[-1]
    assert -3.5 < last.z < -1.5 and last.vz == pytest.approx(-1.0, abs=0.1)
    odometry = flown.link.of("ODOMETRY")[-1]
    assert odometry.z == pytest.approx(last.z, abs=0.05)


def test_motors_are_told_as_shares(flown):
    before, after = flown.link.of("ACTUATOR_OUTPUT_STATUS")[50], None
    after = flown.link.of("ACTUATOR_OUTPUT_STATUS")[-1]
    np.testing.assert_allclose(before.actuator[:4], 0.0, atol=1e-6)
    np.testing.assert_allclose(after.actuator[:4], 0.2, atol=0.04)


def test_the_race_starts_with_arming(flown):
    before, *_, last = statuses(flown.link)
    assert before[2:] == (-1, -1, 0, -1)
    assert last[2] == pytest.approx(2000, abs=30) and last[3:] == (-1, 0, -1)


def test_pictures_decode_and_show_the_first_gate(flown):
    frames = pictures(flown.link)
    parts = frames[75]
    assert [header[1] for header, _ in parts] == list(range(parts[0][0][2]))
    jpeg = b"".join(part for _, part in parts)
    assert len(jpeg) == parts[0][0][3]
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == (360, 640, 3)
    orange = (picture[..., 2] > 150) & (picture[..., 0] < 90)
    assert orange.sum() > 300


def test_vq_2_tells_neither_pose_nor_places():
    session = Session(grand_prix(vq=2))
    session.fly(1.2)
    kinds = {message.get_type() for message in session.link.sent}
    assert not kinds & set(POSE) and "HIGHRES_IMU" in kinds
    tracks = [m for m in session.link.of("ENCAPSULATED_DATA") if m.data[0] == 2]
    data = b"".join(bytes(m.data)[3:] for m in tracks[:3])
    assert struct.unpack_from("<H", data) == (17,)
    for i in range(17):
        number, *geometry = struct.unpack_from("<Hfffffffff", data, 2 + 38 * i)
        assert number == i and geometry == 9 * [0.0]


class TestCommands:
    """One after the other in one flight; each test of what it does is a step of it."""

    @pytest.mark.slow
    def test_what_they_do(self):
        session = Session(grand_prix(vq=1))
        link = session.link
        # Not armed, nothing turns.
        standing = session.state.position[2]
        state = session.fly(0.5, rates(1.0))
        assert not session.bridge.armed(session.bridge_context)
        assert state.position[2] == pytest.approx(standing, abs=0.01)
        link.say(arm())
        session.fly(0.05)
        assert session.bridge.armed(session.bridge_context)
        ack = link.of("COMMAND_ACK")[-1]
        assert (ack.command, ack.result) == (400, 0)
        # Thrust and rates, then an attitude.
        state = session.fly(0.8, rates(0.3))
        assert state.position[2] > 0.5 and state.velocity[2] > 1.0
        q = RollPitchYaw(0.3, 0.0, link.of("ATTITUDE")[-1].yaw).ToQuaternion().wxyz()
        session.fly(0.6, attitude(q, 0.2))
        assert link.of("ATTITUDE")[-1].roll == pytest.approx(0.3, abs=0.03)
        # Velocity and position, in LOCAL_NED.
        session.fly(1.5, velocity(0.0, 0.0, 0.0))
        session.fly(1.5, velocity(1.0, -0.5, 0.0))
        told = link.of("LOCAL_POSITION_NED")[-1]
        assert (told.vx, told.vy, told.vz) == pytest.approx((1.0, -0.5, 0.0), abs=0.1)
        session.fly(5.0, position(0.5, 0.5, -2.0))
        told = link.of("LOCAL_POSITION_NED")[-1]
        assert (told.x, told.y, told.z) == pytest.approx((0.5, 0.5, -2.0), abs=0.1)
        # The four motors: more on the left rolls to the right.
        session.fly(0.1, motors(0.185, 0.215, 0.215, 0.185))
        assert link.of("ATTITUDE")[-1].rollspeed > 0.3
        # What is not finite is refused, and what was wanted before goes on.
        wanted = session.bridge_context.get_discrete_state(0).value().copy()
        link.say(rates(np.nan), velocity(np.inf, 0.0, 0.0), motors(np.nan, 0, 0, 0))
        session.fly(0.01)
        assert link.counts.refused == 3
        assert link.notes.count("To the client: a number is not finite.") == 1
        assert [m.text for m in link.of("STATUSTEXT")] == ["a number is not finite"]
        np.testing.assert_array_equal(session.bridge_context.get_discrete_state(0).value(), wanted)
        link.say(arm(np.nan), arm(2.0))
        session.fly(0.01)
        assert link.counts.refused == 5 and link.of("COMMAND_ACK")[-1].result == 2  # denied
        assert session.bridge.armed(session.bridge_context)
        # A mode is one thing that libraries ask for; it changes nothing.
        wanted = session.bridge_context.get_discrete_state(0).value().copy()
        link.say(command(176))
        session.fly(0.01)
        ack = link.of("COMMAND_ACK")[-1]
        assert (ack.command, ack.result) == (176, 0)
        np.testing.assert_array_equal(session.bridge_context.get_discrete_state(0).value(), wanted)
        # Disarmed, it falls; and unknown commands are none.
        link.say(arm(0.0), command(999))
        session.fly(0.2)
        assert not session.bridge.armed(session.bridge_context)
        assert link.of("COMMAND_ACK")[-1].result == 3  # unsupported
        assert not session.bridge.reset_wanted
        link.say(command(31000))
        session.fly(0.01)
        assert session.bridge.reset_wanted

    def test_timesync_is_answered_with_simulated_time(self):
        session = Session(grand_prix())
        session.fly(0.5)
        session.link.say(mavlink.MAVLink_timesync_message(0, 777))
        session.fly(0.01)
        (answer,) = session.link.of("TIMESYNC")
        assert answer.ts1 == 777 and answer.tc1 == pytest.approx(5e8, abs=4e6)


def test_a_silent_client_on_the_ground_stops_its_motors():
    session = Session(grand_prix())
    session.link.say(arm())
    session.fly(0.3, motors(0.1, 0.1, 0.1, 0.1))
    assert max(session.link.of("ACTUATOR_OUTPUT_STATUS")[-1].actuator) > 0.05
    session.fly(0.45)
    assert max(session.link.of("ACTUATOR_OUTPUT_STATUS")[-1].actuator) > 0.05
    session.fly(0.3)
    assert max(session.link.of("ACTUATOR_OUTPUT_STATUS")[-1].actuator) < 0.01


@pytest.mark.slow
def test_a_client_that_is_killed_in_flight_is_landed_for():
    """It hovers where it was, and is set down without a hard contact."""
    session = Session(grand_prix())
    session.link.say(arm())
    state = session.fly(2.0, velocity(0.0, 0.0, -1.0))
    height = state.position[2]
    assert height > 1.0
    state = session.fly(3.0)
    assert state.position[2] == pytest.approx(height, abs=0.8)
    np.testing.assert_allclose(state.velocity, 0.0, atol=0.1)
    state = session.fly(height / 0.5 + 2.0)
    assert state.position[2] < 0.3
    assert max(session.link.of("ACTUATOR_OUTPUT_STATUS")[-1].actuator) < 0.01
    # It was set down, not dropped: from half a metre, 0.9 kg arrive with 2.8 kg m/s.
    assert all(message.horizontal_minimum_delta < 0.6 for message in session.link.of("COLLISION"))


@pytest.mark.slow
def test_a_collision_with_a_gate_names_the_gate():
    """Onto the side beam of the first gate, which stands in the drone's way."""
    session = Session(grand_prix())
    session.link.say(arm())
    session.fly(0.05)
    gate = session.bridge._track.gates[0]
    beam = gate.X_WG @ np.array([0.0, 0.5 * (INNER + OUTER) / 2, 0.0])
    session.fly(6.0, position(*((beam - session.bridge._origin) * [1, -1, -1])))
    told = session.link.of("COLLISION")
    assert told and {message.id for message in told} == {1001}
    # At most what 0.9 kg have at the speed of a position that is flown to.
    assert 0.0 < max(message.horizontal_minimum_delta for message in told) < 10.0


def test_a_collision_is_told_with_its_impulse():
    """Off the pad and down onto it: with the environment, not with a gate."""
    session = Session(grand_prix())
    session.link.say(arm())
    session.fly(2.5, velocity(0.0, 0.0, -1.0))
    session.link.say(arm(0.0))
    session.fly(1.5)
    told = session.link.of("COLLISION")
    assert told and {message.id for message in told} == {1002}
    fall = max(message.horizontal_minimum_delta for message in told)
    assert 0.9 < fall < 20.0  # 0.9 kg at some metres a second
    wanted = as_setpoint(session.bridge_context.get_discrete_state(0).value())
    assert not wanted.armed


class TestQuirks:
    def test_a_clock_is_ahead_everywhere(self):
        session = Session(grand_prix("{mavlink: {quirks: {clock_offset: 100.0}}}"))
        session.fly(1.0)
        assert session.link.of("HIGHRES_IMU")[-1].time_usec == pytest.approx(101e6, abs=5e4)
        assert session.link.of("ACTUATOR_OUTPUT_STATUS")[-1].time_usec > 100.9e6
        header = PICTURE_HEADER.unpack(session.link.pictures[-1][:24])
        assert header[5] == pytest.approx(101e9, abs=1e8)
        assert statuses(session.link)[-1][1] == pytest.approx(101000, abs=260)

    @pytest.mark.slow
    def test_pictures_are_lost_or_repeated(self):
        text = "{mavlink: {quirks: {lost_pictures: 0.3, repeated_pictures: 0.3}}}"
        session = Session(grand_prix(text))
        session.link.say(arm())
        session.fly(5.0, velocity(0.0, 0.0, -0.5))
        frames = pictures(session.link)
        assert 150 * 0.5 < len(frames) < 150 * 0.85
        assert len(frames) < max(frames) + 1  # numbers are left out
        jpegs = [b"".join(part for _, part in parts) for parts in frames.values()]
        repeated = sum(a == b for a, b in zip(jpegs, jpegs[1:]))
        assert 0.1 * len(jpegs) < repeated < 0.6 * len(jpegs)

    @pytest.mark.repeats
    def test_the_imus_rate_varies_with_load(self):
        session = Session(grand_prix("{mavlink: {quirks: {imu_drop: 0.5}}}"))
        session.fly(6.0)
        times = np.array([m.time_usec for m in session.link.of("HIGHRES_IMU")]) / 1e6
        counts, _ = np.histogram(times, np.arange(7))
        assert counts.min() >= 20 and counts.max() - counts.min() >= 5
        assert session.bridge.imu_messages == len(times) < 0.95 * 62 * 6


def test_commands_for_other_vehicles_are_left_alone():
    session = Session(grand_prix(vq=1))
    session.link.say(arm())
    session.fly(1.5, velocity(0.0, 0.0, -1.0))
    others = position(9.0, 0.0, 0.0), arm(0.0), command(31000)
    for message in others:
        message.target_system = 7
    before = session.link.of("COMMAND_ACK")
    session.link.say(*others)
    session.fly(0.1, velocity(0.0, 0.0, -1.0))
    assert session.bridge.armed(session.bridge_context) and not session.bridge.reset_wanted
    assert session.link.of("COMMAND_ACK") == before


def test_of_set_points_of_one_moment_the_newest_is_followed(monkeypatch):
    """Those before it, which ask for the same things, cost next to nothing."""
    session, followed = Session(grand_prix()), []

    def seen(message, *others):
        followed.append(message)
        return setpoint_of(message, *others)

    monkeypatch.setattr(bridge, "setpoint_of", seen)
    session.link.say(arm(), *[rates(0.1 + 0.001 * i) for i in range(100)], motors(0, 0, 0, 0))
    session.link.say(rates(0.3))
    session.fly(0.01)
    setpoint = as_setpoint(session.bridge_context.get_discrete_state(0).value())
    assert setpoint.thrust == pytest.approx(0.3) and setpoint.armed
    assert session.bridge.commands == 103 and len(followed) == 3


def official_session(**fields):
    return Session(grand_prix("{camera: {fps: 5.0}}", dialect="official", **fields))


@pytest.fixture(scope="module")
def begun():
    """Armed at once, with set-points that do not move it, then through the start."""
    session = official_session(vq=1)
    session.link.say(arm())
    session.fly(13.0, rates(0.0), rate=10.0)
    session.early = session.bridge.armed(session.bridge_context)
    session.fly(1.0, rates(0.0), rate=10.0)
    return session


class TestTheOfficialRace:
    """From the pad to the start, as clients know it."""

    def test_a_countdown_begins_with_arming_once_all_is_loaded(self, begun):
        starts = [(at, start) for _, at, start, *_ in statuses(begun.link)]
        # Some clients wait until they have seen a race that has no start yet.
        assert all(start == (-1 if at < 10650 else 13500) for at, start in starts)
        assert starts[-1] == (pytest.approx(14000, abs=260), 13500)

    def test_who_is_armed_before_the_start_stays_armed(self, begun):
        assert begun.early and begun.bridge.armed(begun.bridge_context)
        armed = [bool(m.base_mode & 128) for m in begun.link.of("HEARTBEAT")]
        assert len(armed) > 135 and all(armed)
        assert begun.output("explorer_status").done

    def test_the_track_is_sent_once_and_no_more(self, begun):
        (handshake,) = begun.link.of("DATA_TRANSMISSION_HANDSHAKE")
        kinds = [m.get_type() for m in begun.link.sent]
        before = kinds[: kinds.index("DATA_TRANSMISSION_HANDSHAKE")]
        assert before.count("HEARTBEAT") == pytest.approx(95, abs=2) and handshake.packets == 3

    def test_a_client_that_comes_later_is_sent_the_track_too(self, begun):
        begun.link.client = ("elsewhere", 1)
        begun.fly(0.2)
        assert len(begun.link.of("DATA_TRANSMISSION_HANDSHAKE")) == 2
        begun.fly(0.5)
        assert len(begun.link.of("DATA_TRANSMISSION_HANDSHAKE")) == 2

    def test_pictures_come_twice_on_the_clock_of_timesync(self, begun):
        datagrams = begun.link.pictures
        assert len(datagrams) > 20 and datagrams[::2] == datagrams[1::2]
        header = PICTURE_HEADER.unpack(datagrams[-1][:24])
        begun.link.say(mavlink.MAVLink_timesync_message(0, 5))
        begun.fly(0.01)
        answer = begun.link.of("TIMESYNC")[-1]
        assert answer.ts1 == 5 and 0 <= answer.tc1 - header[5] < 3e8
        assert answer.tc1 == pytest.approx(
            1_782_259_200e9 + 1e9 * begun.context.get_time(), abs=1e7
        )
        assert 67_000 <= header[3] <= 69_000

    def test_a_client_that_does_not_arm_sees_the_start_too(self):
        """Who waits for it before arming, after a reset here; but not before it is heard."""
        link = Earpiece()
        link.heard = False
        session = Session(grand_prix("{camera: {fps: 5.0}}", dialect="official"), link, before=0.0)
        session.fly(3.8)
        assert session.bridge.flight(session.bridge_context).start == -1.0
        link.heard = True
        session.fly(0.1)
        start = session.bridge.flight(session.bridge_context).start
        assert start == pytest.approx(3.8 + 2.85, abs=0.01)

    @pytest.mark.slow
    def test_who_leaves_the_pad_before_is_disqualified(self):
        session = official_session()
        session.link.say(arm())
        session.fly(0.6, rates(0.5))
        why = session.transport.advance(session.simulator, session.context.get_time() + 0.1)
        assert why == "disqualified: it left its pad before the start"
        texts = [m.text for m in session.link.of("STATUSTEXT")]
        assert "".join(texts) == why

    def test_after_a_reset_it_is_ready_sooner_and_the_clock_goes_on(self):
        link = Earpiece()
        session = Session(grand_prix(dialect="official"), link, before=100.0)
        link.say(arm())
        session.fly(0.3)
        assert session.bridge.flight(session.bridge_context).start == pytest.approx(6.35)
        assert link.of("HIGHRES_IMU")[-1].time_usec == pytest.approx(100.3e6, abs=3e4)
        session.fly(3.5)
        starts = [start for _, _, start, *_ in statuses(link)]
        assert (starts[0], starts[-1]) == (-1, 106_350)

    def test_motors_are_told_from_the_front_left_on(self):
        session = official_session()
        session.link.say(arm())
        session.fly(0.2, motors(0.02, 0.04, 0.06, 0.08))
        told = session.link.of("ACTUATOR_OUTPUT_STATUS")[-1]
        np.testing.assert_allclose(told.actuator[:4], [0.02, 0.04, 0.06, 0.08], atol=0.003)
        speeds = session.output("rotor_speeds")  # front right, rear left, front left, rear right
        assert list(np.argsort(speeds)) == [2, 0, 1, 3]
        assert told.active == 15
