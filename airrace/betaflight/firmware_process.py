"""The process of the firmware, in lockstep with whoever holds its other end."""

import contextlib
import os
import shutil
import socket
import struct
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from airrace.betaflight.firmware import Firmware
from airrace.common.errors import UserError
from airrace.common.processes import ending

PERIOD = 0.001  # s, of a step
CHANNELS = 16  # of the radio
NO_RADIO = CHANNELS * (0,)  # channels of a radio that is not on yet
_SENSORS = struct.Struct("<18d")
_STICKS = struct.Struct(f"<{CHANNELS}H")
_MOTORS = struct.Struct("<H2x16f")
_PORT = struct.Struct("<I")
_PATIENCE = 20.0  # s, that a step may take on a busy computer
_LIBRARY = "lockstep.so"  # in the folder of the process
_PRESSURE = 101325.0  # Pa
REST = np.array((0.0, 0.0, 0.0, 0.0, 0.0, 9.81))  # what an IMU shows at rest


def state_packet(imu: np.ndarray) -> bytes:
    """Returns what the firmware is told of the drone: its IMU, and nothing else that is true.

    Args: imu: angular velocity (rad/s) and specific force (m/s^2) in the axes of B, (6,).
    """
    # Rates are in axes that point forward, right and down. Accelerations are what a sensor in B
    # shows, with the opposite sign. The attitude is level: Betaflight's rate mode does not use it.
    wx, wy, wz, fx, fy, fz = imu.tolist()
    level = 1.0, 0.0, 0.0, 0.0
    return _SENSORS.pack(0.0, wx, -wy, -wz, -fx, -fy, -fz, *level, *6 * [0.0], _PRESSURE)


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
        self._waiting = True  # for what its motors get
        self._motors = np.zeros(CHANNELS)
        self._socket, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.settimeout(_PATIENCE)
        preload = {"LD_PRELOAD": f"./{_LIBRARY}", "AIRRACE_LOCKSTEP_FD": str(other.fileno())}
        with other:
            try:
                shutil.copy(firmware.library, folder / _LIBRARY)  # no path may have a space in it
                self._process = subprocess.Popen(
                    [str(firmware.program)],
                    cwd=folder,
                    env=os.environ | preload,
                    pass_fds=[other.fileno()],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    start_new_session=True,  # Ctrl-C in a terminal is for airrace
                )
            except OSError as e:
                self._socket.close()
                raise UserError(f"{firmware.program} cannot be run: {e.strerror}.") from None

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

    def begin_step(self, imu: np.ndarray, channels: Sequence[int]) -> None:
        """Lets the firmware run for a step; end_step() is to be called before the next one.

        Args: imu: see state_packet(). channels: of the radio, 1000 to 2000, 16 numbers.
        """
        if self.problem is None:
            with contextlib.suppress(OSError):  # end_step() says what is wrong
                self._socket.send(state_packet(imu) + _STICKS.pack(*channels))
            self._waiting = True

    def end_step(self) -> np.ndarray:
        """Returns what the motors get at the end of the step, 1000 to 2000, (16,); 0 if nothing.

        A firmware that does not answer has a ``problem``, and its motors get nothing.
        """
        while self._waiting and self.problem is None:
            message = b""
            try:
                message = self._socket.recv(4096)
            except TimeoutError:
                self.problem = f"Betaflight has not answered for {_PATIENCE:g} s"
                break
            except OSError:  # as at the end
                pass
            if not message:
                self.problem = f"Betaflight {ending(self._process.wait())}"
            elif len(message) == _PORT.size:
                (self.port,) = _PORT.unpack(message)
            else:
                self._motors = np.array(_MOTORS.unpack(message)[1:])
                self._waiting = False
        return self._motors if self.problem is None else np.zeros(CHANNELS)

    def step(self, channels: Sequence[int], imu: np.ndarray = REST) -> np.ndarray:
        """Lets the firmware run for a step, at rest unless an IMU says otherwise.

        Returns: see end_step().
        """
        self.end_step()
        self.begin_step(imu, channels)
        return self.end_step()
