"""The dialects on the wire: captured frames, signs of tilts and turns, and loops that are closed.

The frames are made by an encoder of the tests' own, from what entrants captured.
"""

import dataclasses as dc
import struct

import numpy as np
import pytest
from pydrake.math import RollPitchYaw
from pymavlink.dialects.v20 import common as mavlink

from airrace.mavlink import telemetry
from airrace.mavlink.commands import RefusedError, Situation, make_airframe, setpoint_of
from airrace.mavlink.dialects import CAPTURED, CLIENTS, DIALECTS, ONE, OURS, SPECIFICATION, Dialect
from airrace.mavlink.frames import flipped_quaternion, ned_state
from airrace.mavlink.telemetry import Clock
from airrace.systems.control.setpoint import NO_SETPOINT
from airrace.systems.types import RefereeStatus
from airrace.track.square_gate import SquareGate
from airrace.track.square_track import SquareTrack
from airrace.vehicle import load_vehicle
from airrace.vehicle.state import State
from tests.worlds.mavlink_client import Session, arm, grand_prix, rates

OFFICIAL, CLEAN = DIALECTS["official"], DIALECTS["none"]
AXES = ("roll", "pitch", "yaw")
# Signs of NED's roll, pitch and yaw, or of FRD's rates, on the wire.
SIGNS = {"official": {"angles": (1, -1, -1), "rates": (-1, -1, -1)}}
SIGNS["none"] = {"angles": (1, 1, 1), "rates": (1, 1, 1)}


def frame(number, kind, crc_extra, payload, system=1):
    """Returns a MAVLink 2 frame, as MAVLink's documentation defines it."""
    payload = payload.rstrip(b"\0") or b"\0"
    body = struct.pack("<BBBBBB", len(payload), 0, 0, number, system, 1)
    body += struct.pack("<I", kind)[:3] + payload
    crc = 0xFFFF  # X.25
    for byte in body + bytes([crc_extra]):
        low = byte ^ (crc & 0xFF)
        low = (low ^ (low << 4)) & 0xFF
        crc = (crc >> 8) ^ (low << 8) ^ (low << 3) ^ (low >> 4)
    return b"\xfd" + body + struct.pack("<H", crc)


def packed(message, number=0):
    writer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    writer.seq = number
    return message.pack(writer)


class TestCapturedFrames:
    """What is sent is equal to the bytes of a frame of the official simulator's form."""

    def test_the_heartbeat(self):
        for armed, mode in ((False, 65), (True, 193)):
            captured = frame(0, 0, 50, struct.pack("<IBBBBB", 0, 2, 0, mode, 3, 3))
            assert packed(telemetry.heartbeat(OFFICIAL, armed)) == captured

    def test_the_race_status(self):
        status = struct.pack("<BQqqIq", 1, 12_000, 13_500, -1, 0, -1)
        captured = frame(0, 131, 223, struct.pack("<H", 0) + status.ljust(253, b"\0"))
        ours = telemetry.race_status(Clock(12.0), 13.5, RefereeStatus((), False, None, None, 0), 6)
        assert packed(ours) == captured

    def test_the_track(self):
        """Two gates that look north and east, seen from the pad at the origin."""
        gates = [SquareGate([10.0, 0.0, 2.0], 0.0), SquareGate([20.0, -5.0, 3.0], -90.0)]
        half = 0.5**0.5
        block = struct.pack("<H", 2)
        # Lower edges 1.36 m below; the x axis along the width: west, and north.
        block += struct.pack("<H9f", 0, 10.0, 0.0, -0.64, half, 0.0, 0.0, -half, 2.72, 2.72)
        block += struct.pack("<H9f", 1, 20.0, 5.0, -1.64, 1.0, 0.0, 0.0, 0.0, 2.72, 2.72)
        handshake = struct.pack("<IHHHBBB", len(block), 1, 0, 1, 0, 253, 1)
        data = struct.pack("<BH", 2, 1) + block
        captured = [
            frame(0, 130, 29, handshake),
            frame(0, 131, 223, struct.pack("<H", 0) + data.ljust(253, b"\0")),
        ]
        track = SquareTrack("two", gates=gates)
        ours = list(telemetry.track_messages(OFFICIAL, track, np.zeros(3), hidden=False))
        assert packed(ours[0]) == captured[0]
        (read,) = mavlink.MAVLink(None).parse_buffer(captured[1])
        numbers = [
            struct.unpack_from("<H9f", bytes(m.data), 5 + 38 * i)
            for m in (read, ours[1])
            for i in (0, 1)
        ]
        for theirs, mine in zip(numbers[:2], numbers[2:]):
            sign = np.sign(theirs[4] or theirs[7]) * np.sign(mine[4] or mine[7])
            np.testing.assert_allclose(theirs[:4], mine[:4], atol=1e-6)
            np.testing.assert_allclose(theirs[4:8], sign * np.array(mine[4:8]), atol=1e-6)
            assert theirs[8:] == mine[8:]

    def test_the_imu(self):
        nan = float("nan")
        force, gyro = (-2.999, -0.002, -9.340), (0.1, -0.2, 0.3)
        payload = struct.pack("<Q13fH", 5_000_000, *force, *gyro, *7 * [nan], 0x3F)
        captured = frame(0, 105, 93, payload)
        body = np.array(force) * [1, -1, -1], -np.array(gyro) * [1, -1, -1]
        ours = packed(telemetry.highres_imu(OFFICIAL, Clock(5.0), *body))
        decoded = [mavlink.MAVLink(None).parse_buffer(data)[0] for data in (captured, ours)]
        for name in ("time_usec", "xacc", "yacc", "zacc", "xgyro", "ygyro", "zgyro"):
            theirs, mine = (getattr(message, name) for message in decoded)
            assert theirs == pytest.approx(mine, rel=1e-6), name
        assert len(captured) == len(ours)

    def test_the_header_of_a_picture(self):
        stamp = OFFICIAL.epoch_ns + 10**9
        header = bytes.fromhex("07000000010002000500000002000000") + struct.pack("<Q", stamp)
        *_, last = telemetry.picture_datagrams(
            7, Clock(1.0, epoch=OFFICIAL.epoch_ns).epoch_ns, b"jpegs", 3
        )
        assert last == header + b"gs"


def tilted(axis, angle=0.3, rate=0.0):
    """Returns the NedState of a drone tilted about one axis of NED and FRD, or turning about it."""
    angles = np.zeros(3)
    angles[axis] = angle
    q = flipped_quaternion(RollPitchYaw(angles).ToQuaternion().wxyz())
    R_WB = np.diag([1.0, -1, -1]) @ RollPitchYaw(angles).ToRotationMatrix().matrix()
    R_WB = R_WB @ np.diag([1.0, -1, -1])
    w_FRD = np.zeros(3)
    w_FRD[axis] = rate
    w_W = R_WB @ (w_FRD * [1, -1, -1])
    return ned_state(State(0.0, q, np.zeros(3), w_W, np.array([1.0, 2.0, 3.0])), R_WB, np.zeros(3))


def euler(q):
    return RollPitchYaw(_rotation(q)).vector()


def _rotation(q):
    from pydrake.common.eigen_geometry import Quaternion
    from pydrake.math import RotationMatrix

    return RotationMatrix(Quaternion(np.array(q) / np.linalg.norm(q)))


@pytest.mark.parametrize("name", DIALECTS)
@pytest.mark.parametrize("axis", range(3), ids=AXES)
def test_the_signs_of_a_tilt(name, axis):
    """By hand: roll to the right, pitch up, yaw to the right, each alone."""
    dialect, ned, clock = DIALECTS[name], tilted(axis), Clock(1.0)
    sign = SIGNS[name]["angles"][axis]
    told = telemetry.attitude(dialect, clock, ned)
    assert getattr(told, AXES[axis]) == pytest.approx(0.3 * sign)
    assert all(abs(getattr(told, other)) < 1e-9 for other in AXES if other != AXES[axis])
    # ODOMETRY's quaternion mirrors roll and yaw.
    angles = euler(telemetry.odometry(dialect, clock, ned).q)
    odometry = (-1, 1, -1) if name == "official" else (1, 1, 1)
    assert angles[axis] == pytest.approx(0.3 * odometry[axis])
    position = telemetry.local_position(clock, ned)
    assert (position.vx, position.vy, position.vz) == (1.0, -2.0, -3.0)


@pytest.mark.parametrize("name", DIALECTS)
@pytest.mark.parametrize("axis", range(3), ids=AXES)
def test_the_signs_of_a_turn(name, axis):
    dialect, ned, clock = DIALECTS[name], tilted(axis, 0.0, rate=0.7), Clock(1.0)
    sign = SIGNS[name]["rates"][axis]
    body = ned.rates * [1, -1, -1]
    imu = telemetry.highres_imu(dialect, clock, np.array([0.0, 0.0, 9.81]), body)
    assert (imu.xgyro, imu.ygyro, imu.zgyro)[axis] == pytest.approx(0.7 * sign)
    assert imu.zacc == pytest.approx(-9.81)  # the accelerometer is not mirrored
    for told in (telemetry.attitude(dialect, clock, ned), telemetry.odometry(dialect, clock, ned)):
        assert getattr(told, f"{AXES[axis]}speed") == pytest.approx(0.7 * sign)


@pytest.mark.parametrize("name", DIALECTS)
@pytest.mark.parametrize("axis", range(3), ids=AXES)
def test_a_command_of_the_wires_sign_turns_the_drone_that_way(name, axis):
    """What the gyroscope would say of the turn that is wanted, is the command for it."""
    dialect = DIALECTS[name]
    frame = make_airframe(load_vehicle("vadr")[0], dialect)
    here = Situation(frame, np.zeros(3), np.zeros(3), 0.0, NO_SETPOINT)
    wanted = np.zeros(3)
    wanted[axis] = SIGNS[name]["rates"][axis]
    turned = setpoint_of(rates(0.3, *wanted, mask=144), dialect, here).rates * [1, -1, -1]
    assert turned[axis] > 0.8 and abs(np.delete(turned, axis)).max() < 1e-9
    # And an attitude: NED's numbers, in the official dialect converted to forward, left, up.
    angles = np.zeros(3)
    angles[axis] = 0.3
    q = RollPitchYaw(angles).ToQuaternion().wxyz()
    q = flipped_quaternion(q) if name == "official" else q
    asked = setpoint_of(rates(0.3, mask=7, q=q), dialect, here).quaternion
    np.testing.assert_allclose(euler(flipped_quaternion(asked)), angles, atol=1e-9)


THRUST = {"official": 0.27, "none": 0.195}


@pytest.mark.slow
@pytest.mark.parametrize("name", DIALECTS)
def test_loops_close_as_the_signs_of_the_wire_say(name, monkeypatch):
    """In the plant: turns, a loop on the gyroscope, and one on an attitude with clean signs."""
    hurried = dc.replace(OFFICIAL, loading=0.0, countdown=0.05)  # the race, without the long wait
    monkeypatch.setitem(DIALECTS, "official", hurried)
    session = Session(grand_prix("{camera: {fps: 2.0}}", dialect=name, vq=1))
    session.link.say(arm())
    session.fly(0.2)
    session.fly(0.22, rates(0.5, mask=144))
    # A command of the gyroscope's sign turns the drone so that the gyroscope says it.
    for wanted in np.eye(3):
        session.fly(0.25, rates(THRUST[name], *wanted, mask=144), rate=100.0)
        imu = session.link.of("HIGHRES_IMU")[-1]
        gyro = np.array([imu.xgyro, imu.ygyro, imu.zgyro])
        assert gyro @ wanted == pytest.approx(1.0, abs=0.25)
        session.fly(0.25, rates(THRUST[name], *-wanted, mask=144), rate=100.0)
    # Where rates are those of a stick, officially it turns against what the gyroscope says.
    for wanted in np.eye(3):
        session.fly(0.2, rates(THRUST[name], *0.4 * wanted), rate=100.0)
        imu = session.link.of("HIGHRES_IMU")[-1]
        gyro = np.array([imu.xgyro, imu.ygyro, imu.zgyro])
        turned = -0.4 * np.array(OFFICIAL.stick_gains) if name == "official" else np.full(3, 0.4)
        assert gyro @ wanted == pytest.approx(turned @ wanted, rel=0.25)
        session.fly(0.2, rates(THRUST[name], *-0.4 * wanted), rate=100.0)
    # A loop that is closed on the gyroscope is stable: what it says and what is said agree.
    angle, before = np.zeros(3), [session.link.of("HIGHRES_IMU")[-1].time_usec]

    def hold(imu):
        angle[:] += (imu.time_usec - before[0]) / 1e6 * np.array([imu.xgyro, imu.ygyro, imu.zgyro])
        before[0] = imu.time_usec
        return -4.0 * angle

    close(session, name, hold)
    session.fly(0.8)
    assert np.abs(angle).max() < 0.1 and tilt_of(session).max() < 0.6

    def upright(attitude):  # as entrants close it: pitch the other way round than roll
        pitch = attitude.pitch if name == "official" else -attitude.pitch
        return 4.0 * np.array([-attitude.roll, pitch, 0.0])

    close(session, name, upright, "ATTITUDE", mask=128)
    session.fly(1.0)
    assert np.abs(tilt_of(session)).max() < 0.1

    def level(imu):
        return -4.0 * tilt_of(session)  # in FRD, as it is: only the command has clean signs

    session.link.answer = lambda message: []
    session.fly(0.1, rates(THRUST[name], 1.0, 0.0, 0.0, mask=144), rate=100.0)
    close(session, name, level)
    session.fly(1.0)
    assert (np.abs(tilt_of(session)).max() < 0.1) == (name == "none")


def close(session, name, law, kind="HIGHRES_IMU", mask=144):
    """Lets a client answer each message of a kind with the body rates of a law."""

    def answer(message):
        if message.get_type() != kind:
            return []
        return [rates(THRUST[name], *np.clip(law(message), -3.0, 3.0), mask=mask)]

    session.link.answer = answer


def tilt_of(session):
    """Returns roll, pitch and no yaw (rad), of NED, as they are."""
    roll, pitch, _ = euler(flipped_quaternion(np.array(session.state.quaternion)))
    return np.array([roll, pitch, 0.0])


class TestData:
    def test_every_field_says_who_says_so(self):
        for field in dc.fields(Dialect):
            assert field.metadata["what"]
            assert field.metadata["says"] in (SPECIFICATION, CAPTURED, CLIENTS, ONE, OURS)

    def test_both_have_values_of_one_kind(self):
        for field in dc.fields(Dialect):
            official, clean = getattr(OFFICIAL, field.name), getattr(CLEAN, field.name)
            assert np.size(official) == np.size(clean) or None in (official, clean)
        for dialect in DIALECTS.values():
            assert np.linalg.norm(dialect.gate_axes) == pytest.approx(1.0)

    def test_unknown_frames_are_only_denied_in_the_clean_one(self):
        message = mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 99, 3576, *11 * [0.0]
        )
        for dialect, is_denied in ((OFFICIAL, False), (CLEAN, True)):
            frame = make_airframe(load_vehicle("vadr")[0], dialect)
            here = Situation(frame, np.zeros(3), np.zeros(3), 0.0, NO_SETPOINT)
            if is_denied:
                with pytest.raises(RefusedError):
                    setpoint_of(message, dialect, here)
            else:
                setpoint_of(message, dialect, here)
