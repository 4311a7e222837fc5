"""A board at a serial port, which is the firmware in software behind a pseudo-terminal."""

import contextlib
import json
import os
import pty
import select
import subprocess
import sys
import threading
import time
import tty

import numpy as np
import pytest

from airrace.betaflight.firmware_process import NO_RADIO, PERIOD, FirmwareProcess
from airrace.betaflight.guard import Guard, Setup
from airrace.betaflight.settings import configure
from airrace.common.errors import UserError
from tests.worlds.network import CAN_UNSHARE, own_network

HOVER = np.array((9.81, 0.0, 0.0, 0.0))
BOOT = 6.0  # s, in which it calibrates
SETTINGS = "set serial_update_rate_hz = 2000\nset blackbox_device = NONE\nset failsafe_delay = 2\n"


class SerialBoard:
    """The firmware in real time, at rest, whose radio is MSP at a serial port.

    Attributes:
        place: the file of the serial port.
        dump: its settings.
        motors: what the first four get.
    """

    def __init__(self, process, dump):
        self.dump, self._process = dump, process
        process.hold(BOOT, NO_RADIO)
        self.motors = np.full(4, 1000.0)
        self._ours, self._theirs = pty.openpty()
        tty.setraw(self._theirs)
        self.place = os.ttyname(self._theirs)
        self._connection, self._over = process.connect(), threading.Event()
        self._threads = [threading.Thread(target=each) for each in (self._relay, self._run)]

    def __enter__(self):
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_):
        self._over.set()
        for thread in self._threads:
            thread.join()
        self._connection.close()
        for descriptor in (self._ours, self._theirs):
            os.close(descriptor)

    def _relay(self):
        there = self._connection.fileno()
        while not self._over.is_set():
            for source in select.select([self._ours, there], [], [], 0.05)[0]:
                os.write(there if source == self._ours else self._ours, os.read(source, 4096))

    def _run(self):
        due = time.monotonic()
        while not self._over.is_set():
            self.motors = self._process.step(NO_RADIO)[:4]
            due = max(due + PERIOD, time.monotonic() - PERIOD)  # what it is late is lost
            time.sleep(max(0.0, due - time.monotonic()))

    def turns(self, within):
        """Waits until all motors turn, at most some time (s); returns whether they do."""
        return self._wait(lambda: (self.motors > 1100.0).all(), within)

    def stands(self, within):
        """Waits until no motor turns; see turns()."""
        return self._wait(lambda: (self.motors == 1000.0).all(), within)

    def _wait(self, condition, within):
        end = time.monotonic() + within
        while not condition() and time.monotonic() < end:
            time.sleep(0.005)
        return condition()


@pytest.fixture
def board(firmware, shipped, tmp_path):
    source, folder = tmp_path / "team.txt", tmp_path / "firmware"
    source.write_text(shipped.read_text() + SETTINGS)
    folder.mkdir()
    dump, refused = configure(firmware, source, folder)
    assert refused == []
    with contextlib.closing(FirmwareProcess(firmware, folder)) as process:
        with SerialBoard(process, dump) as board:
            yield board


def fly(guard, board, duration=0.0):
    """Commands a hover until the motors turn, and for a time (s) on."""
    for _ in range(500):
        guard.command(HOVER)
        if guard.poll() is not None or board.turns(0.01):
            break
    for _ in range(round(duration / 0.01)):
        guard.command(HOVER)
        time.sleep(0.01)


@pytest.mark.repeats
def test_a_board_follows_and_is_disarmed_when_nothing_is_commanded(board):
    with contextlib.closing(Guard(Setup(board.place, board.dump, "Default", False))) as guard:
        fly(guard, board)
        assert guard.poll() is None and board.stands(0.1)  # nobody may arm it
    with contextlib.closing(Guard(Setup(board.place, board.dump, "Default", True))) as guard:
        guard.arm()
        fly(guard, board, 0.3)
        assert guard.poll() is None and guard.is_armed and board.turns(0.1)
        assert board.stands(0.5)  # nothing is commanded any more
        assert guard.poll() == "the autonomy has commanded nothing for 0.2 s"
    with contextlib.closing(Guard(Setup(board.place, board.dump, "Default", True))) as guard:
        guard.arm()
        fly(guard, board)
        assert board.turns(0.1)
        guard.close()
        assert board.stands(0.1)


PROGRAM = """
import sys, time
import numpy as np
from airrace.betaflight.guard import Guard, Setup
guard = Guard(Setup(sys.argv[1], sys.stdin.read(), "Default", True))
guard.arm()
while guard.poll() is None:
    guard.command(np.array((9.81, 0.0, 0.0, 0.0)))
    time.sleep(0.01)
"""


@pytest.mark.slow
def test_whoever_is_killed_the_board_is_disarmed(board):
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, board.place], stdin=subprocess.PIPE, text=True
    ) as autonomy:
        autonomy.stdin.write(board.dump)
        autonomy.stdin.close()
        assert board.turns(20.0)
        autonomy.kill()
        assert board.stands(0.5)
    time.sleep(0.5)  # until the guard has gone
    with contextlib.closing(Guard(Setup(board.place, board.dump, "Default", True))) as guard:
        guard.arm()
        fly(guard, board)
        assert board.turns(0.1)
        guard._process.kill()
        assert board.stands(2.0)  # its own failsafe acts
        assert guard.poll() == "what guards the board was killed: SIGKILL"


def test_what_is_no_board_or_another_is_one_sentence(board, tmp_path):
    with pytest.raises(UserError, match="no board at"):
        Guard(Setup(str(tmp_path / "ttyACM0"), board.dump, "Default", False))
    other = board.dump.replace("roll_rc_rate = 60", "roll_rc_rate = 7")
    with pytest.raises(UserError, match="roll_rc_rate = 60, and the settings that you give 7"):
        Guard(Setup(board.place, other, "Default", False))


@pytest.mark.repeats
@pytest.mark.skipif(not CAN_UNSHARE, reason="a network of one's own (unshare -n) takes root")
def test_a_board_turns_its_motors_beside_a_race_with_hardware_in_the_loop(board, tmp_path):
    """A person starts the autonomy in a terminal, and arms; the board's motors do as the drone's."""
    dump = tmp_path / "dump.txt"
    dump.write_text(board.dump)
    fields = "camera: {width: 640, height: 360}, referee: {time_limit: 8.0}"
    airrace = [sys.executable, "-m", "airrace", "hitl"]
    link = ["--scenario_text", f"{{{fields}}}"]
    to_board = ["--flight_controller", f"msp:{board.place}", "--betaflight_config", str(dump)]
    keyboard, terminal = pty.openpty()
    environment = os.environ | {"AIRRACE_PATIENCE": "10"}
    result = tmp_path / "race"
    with own_network():  # which processes that are started meanwhile are in
        autonomy = subprocess.Popen(
            [*airrace, "autonomy", *link, *to_board, "--allow_arming", "--output", tmp_path / "a"],
            stdin=terminal,
            env=environment,
        )
        simulation = subprocess.Popen(
            [*airrace, "simulation", *link, "--no-meshcat", "--no-report", "--output", result],
            env=environment,
        )
    try:
        os.write(keyboard, b"ARM\n")
        with simulation:
            assert board.turns(120.0)
        # The race ends, or on a computer that is too slow, the board is disarmed in doubt.
        assert json.loads((result / "race.json").read_text())["dnf_reason"]
        autonomy.wait(30.0)
        assert board.stands(1.0)
    finally:
        autonomy.kill()
        autonomy.wait()
        for descriptor in (keyboard, terminal):
            os.close(descriptor)
