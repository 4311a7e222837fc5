"""MSP: its frames, what a board answers, and what it is never told."""

import contextlib
import os
import pty
import socket
import struct
import threading

import pytest

from airrace.betaflight import msp
from airrace.betaflight.firmware_process import NO_RADIO, FirmwareProcess
from airrace.betaflight.msp import Decoder, Frame, Msp, encode, open_msp
from airrace.common.errors import UserError


def answer(command, payload=b"", direction=b">"):
    frame = bytearray(encode(command, payload))
    frame[2:3] = direction
    return bytes(frame)


def test_frames_are_found_among_anything():
    stream = b"noise$M" + answer(108, b"abc") + b"$$M" + answer(1) + answer(7, b"", b"!")
    assert encode(108) == b"$M<\x00\x6c\x6c"
    found = [Frame(108, b"abc", False), Frame(1, b"", False), Frame(7, b"", True)]
    broken = answer(108, b"xyz")[:-1] + b"\x00"
    decoder = Decoder()
    assert list(decoder.feed(broken + answer(108, b"abc"))) == [found[0]]
    decoder = Decoder()
    bytewise = [each for i in range(len(stream)) for each in decoder.feed(stream[i : i + 1])]
    assert bytewise == found


@contextlib.contextmanager
def board(answers):
    """Yields an Msp whose board gives answers, one for each question."""
    ours, theirs = socket.socketpair()

    def serve():
        for each in answers:
            theirs.recv(4096)
            theirs.sendall(each)

    thread = threading.Thread(target=serve)
    thread.start()
    with ours, theirs:
        yield Msp(ours.fileno())
        thread.join()


def test_what_a_board_does_not_say_is_said(monkeypatch):
    monkeypatch.setattr(msp, "_PATIENCE", 0.2)
    with board([answer(msp.ATTITUDE, b"\x01")]) as asked:
        with pytest.raises(UserError, match="answers less than MSP says"):
            asked.attitude()
    with board([answer(msp.ATTITUDE, direction=b"!")]) as asked:
        with pytest.raises(UserError, match="does not know the MSP command 108"):
            asked.attitude()
    with board([b"nothing of it"]) as asked:
        with pytest.raises(UserError, match="does not answer to the MSP command 108"):
            asked.attitude()
    ours, theirs = socket.socketpair()
    with ours:
        theirs.close()
        with pytest.raises(UserError, match="link to the board is gone"):
            Msp(ours.fileno()).attitude()


def test_motors_are_not_turned_one_by_one():
    with board([]) as told:
        with pytest.raises(UserError, match="SET_MOTOR"):
            told.tell(msp.SET_MOTOR, struct.pack("<8H", *8 * [1100]))


def test_a_serial_port_is_spoken_to_and_who_is_not_there_is_said(tmp_path):
    ours, theirs = pty.openpty()
    try:
        with open_msp(os.ttyname(theirs)) as told:
            told.set_raw_rc((1500, 1500, 1000, 1500))
            assert os.read(ours, 100) == encode(200, struct.pack("<4H", 1500, 1500, 1000, 1500))
    finally:
        os.close(ours)
        os.close(theirs)
    for place in (str(tmp_path / "ttyACM0"), "/dev/null", "127.0.0.1:1"):
        with pytest.raises(UserError, match="no board at"), open_msp(place):
            pass


def test_the_firmware_answers_during_a_flight(firmware, tmp_path):
    with contextlib.closing(FirmwareProcess(firmware, tmp_path)) as process:
        for _ in range(1000):
            process.step(NO_RADIO)
        over = threading.Event()

        def fly():
            while not over.is_set():
                process.step(NO_RADIO)

        thread = threading.Thread(target=fly)
        thread.start()
        try:
            with open_msp(f"127.0.0.1:{process.port}") as asked:
                assert asked.version() == f"BTFL {firmware.version}"
                # It stands upright: its accelerometer shows one g, 256, along its z, upwards.
                assert asked.raw_imu().accelerometer == (0, 0, 256)
                assert asked.attitude().roll == 0.0
                assert asked.motors()[:5] == (1000, 1000, 1000, 1000, 0)
                status = asked.status()
                assert not status.armed and status.arming_disabled
        finally:
            over.set()
            thread.join()
