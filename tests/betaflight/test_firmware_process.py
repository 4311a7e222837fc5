"""The firmware's process: in lockstep, on no fixed ports, and gone with whoever started it."""

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from airrace.betaflight.firmware_process import NO_RADIO, REST, FirmwareProcess, measure_pace
from airrace.common.errors import UserError


@pytest.fixture
def process(firmware, tmp_path):
    library = tmp_path / "with a space.so"
    shutil.copy(firmware.library, library)
    (tmp_path / "run").mkdir()
    process = FirmwareProcess(firmware._replace(library=library), tmp_path / "run")
    with contextlib.closing(process):
        yield process


def is_alive(number: int) -> bool:
    try:
        return Path(f"/proc/{number}/stat").read_text().split(") ")[1][0] != "Z"
    except FileNotFoundError:
        return False


def test_its_fixed_ports_may_be_taken(firmware, tmp_path):
    with contextlib.ExitStack() as taken:
        for kind, port in [
            (socket.SOCK_DGRAM, 9003), (socket.SOCK_DGRAM, 9004), (socket.SOCK_STREAM, 5761)
        ]:  # fmt: skip
            held = taken.enter_context(socket.socket(socket.AF_INET, kind))
            with contextlib.suppress(OSError):  # somebody has it already: as good
                held.bind(("127.0.0.1", port))
        process = taken.enter_context(contextlib.closing(FirmwareProcess(firmware, tmp_path)))
        for _ in range(500):
            process.step(NO_RADIO)
        assert process.problem is None
        assert process.port not in (None, 5761)


def test_what_is_killed_is_said_and_its_motors_stop(process):
    process.step(NO_RADIO)
    os.kill(process.number, signal.SIGKILL)
    assert not process.step(NO_RADIO).any()
    assert process.problem == "Betaflight was killed: SIGKILL"
    assert not process.step(NO_RADIO).any()


def test_a_firmware_that_hangs_is_said(process, monkeypatch):
    monkeypatch.setattr("airrace.betaflight.firmware_process._PATIENCE", 0.1)
    process._socket.settimeout(0.1)
    process.step(NO_RADIO)
    os.kill(process.number, signal.SIGSTOP)
    process.step(NO_RADIO)
    assert process.problem == "Betaflight has not answered for 0.1 s"
    begin = time.monotonic()
    for _ in range(1000):  # nobody reads them
        process.step(NO_RADIO)
    assert time.monotonic() - begin < 1.0


def test_it_ends_with_its_parent_however_that_ends(firmware, tmp_path):
    program = (
        "import sys, time; from pathlib import Path\n"
        "from airrace.betaflight.firmware import find_firmware\n"
        "from airrace.betaflight.firmware_process import FirmwareProcess, NO_RADIO\n"
        f"process = FirmwareProcess(find_firmware(), Path({str(tmp_path)!r}))\n"
        "process.step(NO_RADIO)\n"
        "print(process.number, flush=True); time.sleep(60)\n"
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE) as parent:
        number = int(parent.stdout.readline())
        assert is_alive(number)
        parent.kill()
    for _ in range(100):
        if not is_alive(number):
            break
        time.sleep(0.05)
    assert not is_alive(number)


def test_steps_that_it_is_told_of_at_once_are_as_one_by_one(configured, firmware, sticks, tmp_path):
    answers = []
    for name in ("one by one", "at once"):
        shutil.copytree(configured[0], tmp_path / name)
        with contextlib.closing(FirmwareProcess(firmware, tmp_path / name)) as process:
            process.hold(0.5, NO_RADIO)
            process.hold(5.5, sticks.at_rest(False))
            process.hold(0.3, sticks.at_rest(True))
            if name == "at once":
                process.hold(0.32, sticks.channels_of_thrust(0.2))
            else:
                for _ in range(320):
                    process.step(sticks.channels_of_thrust(0.2))
            answers.append(process.step(sticks.channels_of_thrust(0.3)))
    np.testing.assert_array_equal(*answers)
    assert (answers[0][:4] > 1100.0).all()


def test_its_pace_is_measured_and_what_does_not_run_is_said(firmware, tmp_path):
    pace = measure_pace(firmware)
    assert pace.steps > 100 and 0.0 < pace.in_time <= 1.0 and 0.0 < pace.p99 < 1.0
    broken = tmp_path / "broken"
    broken.write_text("#!/bin/false\n")
    broken.chmod(0o755)
    with pytest.raises(UserError, match="exit code 1: .*build --again"):
        measure_pace(firmware._replace(program=broken))


@pytest.mark.repeats
def test_the_same_steps_are_answered_alike_by_two_at_once_on_a_busy_computer(
    firmware, configured, sticks, tmp_path
):
    channels = 500 * [NO_RADIO] + 5000 * [sticks.at_rest(False)]
    channels += 300 * [sticks.at_rest(True)] + 200 * [sticks.channels_of_thrust(0.2)]
    turn = REST + np.array((0.3, -0.2, 0.1, 0.0, 0.0, 0.0))

    def flights(number):
        folders = [tmp_path / f"{i}_of_{number}" for i in range(number)]
        with contextlib.ExitStack() as stack:
            for folder in folders:
                shutil.copytree(configured[0], folder)
            processes = [
                stack.enter_context(contextlib.closing(FirmwareProcess(firmware, folder)))
                for folder in folders
            ]
            answers = [[] for _ in processes]
            for i, each in enumerate(channels):
                for process, answer in zip(processes, answers):
                    answer.append(process.step(each, REST if i < 5800 else turn))
            return answers

    (alone,) = flights(1)
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(4)]
    try:
        for answer in flights(2):
            np.testing.assert_array_equal(answer, alone)
    finally:
        for each in busy:
            each.kill()
            each.wait()
    assert len({tuple(outputs) for outputs in alone[-100:]}) > 50  # its motors do something
