"""The process of the firmware, in lockstep with whoever holds its other end."""

import contextlib
import os
import socket
import struct
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from airrace.betaflight.firmware import BUILD_AGAIN, Firmware
from airrace.common.errors import UserError
from airrace.common.held_folders import temporary_folder
from airrace.common.processes import ending

PERIOD = 0.001  # s, of a step
CHANNELS = 16  # of the radio
NO_RADIO = CHANNELS * (0,)  # channels of a radio that is not on yet
# A Step of lockstep.c, and Motors.
_STEP = np.dtype([("sensors", "<f8", 18), ("channels", "<u2", CHANNELS)])
_MOTORS = np.dtype([("count", "<u2"), ("unused", "<u2"), ("outputs", "<f4", 16)])
_PORT = struct.Struct("<I")
_PATIENCE = 20.0  # s, that a step may take on a busy computer
_AT_ONCE = 50  # steps that it is told of at once: sockets have room for them
# Of measure_pace(): s, steps at once, steps in real time, and s between these.
_WARM_UP, _AT_ONE_GO, _TIMED, _BREAK = 0.5, 500, 300, 0.0009
_PRESSURE = 101325.0  # Pa
REST = np.array((0.0, 0.0, 0.0, 0.0, 0.0, 9.81))  # what an IMU shows at rest
LEVEL = np.array((1.0, 0.0, 0.0, 0.0))  # an attitude


# Rates and attitudes are told in axes that point forward, right and down. Accelerations are what a
# sensor in B shows, with the opposite sign.
_SIGNS = np.array((1.0, -1.0, -1.0, -1.0, -1.0, -1.0))
_TURNED = np.array((1.0, 1.0, -1.0, -1.0))  # quaternions
_IMU, _ATTITUDE = slice(1, 7), slice(7, 11)  # among the sensors


class FirmwareProcess:
    """A process of the firmware, between whose steps nothing happens.

    It is told of its sensors and its radio, runs for a millisecond of its own time, and says what
    its motors get; see lockstep.c. The process uses no fixed ports: it is spoken to on a socket
    that only the two have. It ends with this object, and with this process however that ends.

    Attributes:
        problem: why it does not fly any more, one sentence; None while it does.
        port: of its command line and of MSP, on loopback; None before the firmware has opened it.
    """

    def __init__(self, firmware: Firmware, folder: Path):
        """Starts the process.

        Args: firmware: what to run. folder: its settings are in it, in ``eeprom.bin``.

        Raises:
            UserError: if it cannot be started.
        """
        self.problem: str | None = None
        self.port: int | None = None
        self._answers = 1  # that are to come: at first, of its start
        self._motors: np.ndarray = np.zeros(CHANNELS)
        self._step = np.zeros((), _STEP)
        sensors, self._channels = self._step["sensors"], self._step["channels"]
        self._imu, self._attitude = sensors[_IMU], sensors[_ATTITUDE]
        sensors[-1] = _PRESSURE
        self._answer = np.zeros((), _MOTORS)
        self._socket, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.settimeout(_PATIENCE)
        with other:
            try:
                with firmware.library.open("rb") as library:
                    # An open file has no spaces in its path, and is there whatever becomes of the
                    # folders: without the library, the firmware would never end.
                    preload = f"/proc/self/fd/{library.fileno()}"
                    number = str(other.fileno())
                    self._process = subprocess.Popen(
                        [str(firmware.program)],
                        cwd=folder,
                        env=os.environ | {"LD_PRELOAD": preload, "AIRRACE_LOCKSTEP_FD": number},
                        pass_fds=[other.fileno(), library.fileno()],
                        stdin=subprocess.DEVNULL,
                        stdout=subprocess.DEVNULL,
                        stderr=subprocess.DEVNULL,
                        start_new_session=True,  # Ctrl-C in a terminal is for airrace
                    )
            except OSError as e:
                self._socket.close()
                raise UserError(
                    f"{firmware.program} cannot be run ({e.strerror}): {BUILD_AGAIN}."
                ) from None

    def close(self) -> None:
        """Ends the process."""
        self._process.kill()
        self._process.wait()
        self._socket.close()

    @property
    def number(self) -> int:
        """The process' number."""
        return self._process.pid

    def connect(self) -> socket.socket:
        """Returns a connection to the firmware's command line and MSP.

        Raises:
            OSError: if there is none.
        """
        try:
            return socket.create_connection(("127.0.0.1", self.port or 0))
        except OSError:  # where the computer prefers the other loopback
            return socket.create_connection(("::1", self.port or 0))

    def begin_step(
        self, imu: np.ndarray, channels: Sequence[int], attitude: np.ndarray = LEVEL
    ) -> None:
        """Lets the firmware run for a step; end_step() is to be called before the next one.

        Args:
            imu: angular velocity (rad/s) and specific force (m/s^2) in the axes of B, (6,).
            channels: of the radio, 1000 to 2000, 16 numbers.
            attitude: R_WB as a quaternion, (4,): this firmware has no filter that finds it. Its
                rate mode uses none.
        """
        if self.problem is None:
            np.multiply(imu, _SIGNS, out=self._imu)
            np.multiply(attitude, _TURNED, out=self._attitude)
            self._channels[:] = channels
            try:
                self._socket.send(self._step)
            except OSError:
                pass  # end_step() says what is wrong
            self._answers += 1

    def end_step(self) -> np.ndarray:
        """Returns what the motors get at the end of the step, 1000 to 2000, (16,); 0 if nothing.

        A firmware that does not answer has a ``problem``, and its motors get nothing.
        """
        while self._answers and self.problem is None:
            size = 0
            try:
                size = self._socket.recv_into(self._answer)
            except TimeoutError:
                self.problem = f"Betaflight has not answered for {_PATIENCE:g} s"
                break
            except OSError:  # as at the end
                pass
            if not size:
                self.problem = f"Betaflight {ending(self._process.wait())}"
            elif size == _PORT.size:
                (self.port,) = _PORT.unpack_from(self._answer)
            else:
                self._motors = self._answer["outputs"].astype(float)
                self._answers -= 1
        return self._motors if self.problem is None else np.zeros(CHANNELS)

    def step(self, channels: Sequence[int], imu: np.ndarray = REST) -> np.ndarray:
        """Lets the firmware run for a step, at rest unless an IMU says otherwise.

        Returns: see end_step().
        """
        self.end_step()
        self.begin_step(imu, channels)
        return self.end_step()

    def hold(self, duration: float, channels: Sequence[int], imu: np.ndarray = REST) -> np.ndarray:
        """Lets the firmware run for a time (s) in which nothing changes, as step() would.

        It is told of many steps at once, so that it need not wait for this process at each.

        Returns: see end_step().
        """
        self.end_step()
        steps = round(duration / PERIOD)
        for begin in range(0, steps, _AT_ONCE):
            for _ in range(min(_AT_ONCE, steps - begin)):
                self.begin_step(imu, channels)
            self.end_step()
        return self._motors if self.problem is None else np.zeros(CHANNELS)


class Pace(NamedTuple):
    """How fast a firmware makes its steps, if nothing else is to be done."""

    steps: float  #: a second, one after the other
    in_time: float  #: share of those that were to begin each millisecond, and ended within it
    p99: float  #: what 99 % of these took at most, from when they were to begin (s)


def measure_pace(firmware: Firmware) -> Pace:
    """Measures the pace of a firmware; it takes half a second.

    Raises:
        UserError: if it does not run.
    """
    with temporary_folder() as folder:
        with contextlib.closing(FirmwareProcess(firmware, folder)) as process:
            process.hold(_WARM_UP, NO_RADIO)
            begin = time.perf_counter()
            for _ in range(_AT_ONE_GO):
                process.step(NO_RADIO)
            spent = time.perf_counter() - begin
            took = np.array([_timed_step(process) for _ in range(_TIMED)])
            if process.problem is not None:
                raise UserError(f"{process.problem}: {BUILD_AGAIN}.")
    in_time = float(np.mean(took < PERIOD))
    return Pace(_AT_ONE_GO / spent, in_time, float(np.quantile(took, 0.99)))


def _timed_step(process: FirmwareProcess) -> float:
    """Waits as for the next step in real time; returns how long it then takes (s)."""
    due = time.perf_counter() + _BREAK
    time.sleep(_BREAK)
    process.step(NO_RADIO)
    return time.perf_counter() - due
