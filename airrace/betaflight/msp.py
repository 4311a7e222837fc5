"""Betaflight's serial protocol (MSP, version 1): what a board is asked, and what it is told.

A frame is ``$M``, a direction (``<`` to the board, ``>`` from it, ``!`` refused by it), the size of
the payload, the command, the payload, and the exclusive or of all from the size on. Numbers are
little-endian.
"""

import contextlib
import functools
import operator
import os
import select
import socket
import struct
import termios
import time
import tty
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from airrace.common.errors import UserError

API_VERSION, FC_VARIANT, FC_VERSION = 1, 2, 3
MODE_RANGES, RX_MAP = 34, 64
RAW_IMU, MOTOR, ATTITUDE, RC_TUNING = 102, 104, 108, 111
STATUS_EX = 150
SET_RAW_RC = 200
SET_MOTOR = 214  # turns motors on a table: refused, unless it is allowed by hand
MOTORS = 8
ARMED = 1  # of Status.modes
# Of Status.arming_disabled, from its first bit on, as Betaflight's command line calls them.
NOT_ARMING = (
    "NOGYRO FAILSAFE RXLOSS NOT_DISARMED BOXFAILSAFE RUNAWAY CRASH THROTTLE ANGLE BOOTGRACE"
    " NOPREARM LOAD CALIB CLI CMS BST MSP PARALYZE GPS RESCUE_SW DSHOT_TELEM REBOOT_REQD"
    " DSHOT_BBANG NO_ACC_CAL MOTOR_PROTO FLIP_SWITCH ALT_HOLD_SW POS_HOLD_SW ARM_SWITCH"
).split()
_PATIENCE = 1.0  # s, for an answer
_TUNING = "<5Bx2B2x5Bx6xB"  # of RC_TUNING
_TUNED = (
    "roll_rc_rate roll_expo roll_srate pitch_srate yaw_srate thr_mid thr_expo yaw_expo yaw_rc_rate"
    " pitch_rc_rate pitch_expo throttle_limit_type rates_type"
).split()
_RATES = "BETAFLIGHT", "RACEFLIGHT", "KISS", "ACTUAL", "QUICK"
_LIMITS = "OFF", "SCALE", "CLIP"
_FIRST, _STEP = 900, 25  # us, of ranges of modes
_HEAD = 5  # bytes before the payload
_SHORTEST = _HEAD + 1
_BAUD = termios.B115200


class Frame(NamedTuple):
    """What a board says."""

    command: int
    payload: bytes
    refused: bool  #: whether it does not take the command


def encode(command: int, payload: bytes = b"") -> bytes:
    """Returns the frame that tells or asks a board something."""
    body = bytes((len(payload), command)) + payload
    return b"$M<" + body + bytes((_checksum(body),))


def _checksum(body: bytes) -> int:
    return functools.reduce(operator.xor, body, 0)


class Decoder:
    """Finds frames in what a board sends, whatever else comes between them."""

    def __init__(self) -> None:
        self._left = b""

    def feed(self, data: bytes) -> Iterator[Frame]:
        """Yields the frames that are complete with some more data; wrong ones are left out."""
        self._left += data
        while (start := self._left.find(b"$M")) >= 0:
            self._left = self._left[start:]
            if len(self._left) < _SHORTEST:
                return
            size, command = self._left[3], self._left[4]
            end = _HEAD + size
            if self._left[2] not in b">!":
                self._left = self._left[2:]
            elif len(self._left) <= end:
                return
            elif _checksum(self._left[3:end]) != self._left[end]:
                self._left = self._left[2:]  # a frame may begin in it
            else:
                frame = Frame(command, self._left[_HEAD:end], self._left[2] == ord("!"))
                self._left = self._left[end + 1 :]
                yield frame
        self._left = self._left[-1:] if self._left.endswith(b"$") else b""


class Attitude(NamedTuple):
    """As the board estimates it."""

    roll: float  #: (deg)
    pitch: float  #: (deg)
    yaw: float  #: (deg)


class RawImu(NamedTuple):
    """As the sensors count, in the board's axes."""

    accelerometer: tuple[int, int, int]
    gyroscope: tuple[int, int, int]  #: (deg/s)
    magnetometer: tuple[int, int, int]


class Status(NamedTuple):
    """What a board says of itself."""

    cycle_time: int  #: of its loop (us)
    modes: int  #: bits; ARMED is one
    arming_disabled: int  #: bits, each a reason not to arm

    @property
    def armed(self) -> bool:
        return bool(self.modes & ARMED)

    @property
    def reasons(self) -> str:
        """Why the board does not arm, by Betaflight's names."""
        named = [name for i, name in enumerate(NOT_ARMING) if self.arming_disabled >> i & 1]
        return ", ".join(named) or "it does not say why"


class Tuning(NamedTuple):
    """What a board makes of its sticks, by the names of its settings."""

    values: dict[str, str]
    channels: tuple[int, ...]  #: where roll, pitch, yaw and throttle are, from 0
    #: Of each mode's range: its number, 0 to arm, its channel after the sticks, from and to (us).
    ranges: tuple[tuple[int, int, int, int], ...]


class Msp:
    """Speaks to a board, over anything that has a descriptor."""

    def __init__(self, descriptor: int, *, allow_set_motor: bool = False):
        """Args: descriptor: of a socket or a serial port. allow_set_motor: see SET_MOTOR."""
        self._descriptor, self._allow_set_motor = descriptor, allow_set_motor
        self._decoder = Decoder()

    def tell(self, command: int, payload: bytes = b"") -> None:
        """Sends a frame.

        Raises:
            UserError: if the link is gone, or it would turn motors one by one.
        """
        if command == SET_MOTOR and not self._allow_set_motor:
            raise UserError("SET_MOTOR turns motors past every safety of the board: it is refused.")
        try:
            os.write(self._descriptor, encode(command, payload))
        except OSError as e:
            raise UserError(
                f"The link to the board is gone ({e.strerror}): connect again."
            ) from None

    def ask(self, command: int, payload: bytes = b"") -> bytes:
        """Sends a frame; returns the payload of the answer.

        Raises:
            UserError: if there is none within a second, or the board refuses the command.
        """
        self.tell(command, payload)
        limit = time.monotonic() + _PATIENCE
        while (left := limit - time.monotonic()) > 0.0:
            if not select.select([self._descriptor], [], [], left)[0]:
                break
            for frame in self._decoder.feed(self._read()):
                if frame.command == command:
                    if frame.refused:
                        raise UserError(f"The board does not know the MSP command {command}.")
                    return frame.payload
        raise UserError(
            f"The board does not answer to the MSP command {command}: is MSP on at this port?"
        )

    def _read(self) -> bytes:
        with contextlib.suppress(OSError):
            if data := os.read(self._descriptor, 4096):
                return data
        raise UserError("The link to the board is gone: connect again.")

    def version(self) -> str:
        """Returns the firmware and its version, such as ``BTFL 4.6.0``."""
        major, minor, patch = _unpacked("<3B", self.ask(FC_VERSION))
        return f"{self.ask(FC_VARIANT)[:4].decode('ascii', 'replace')} {major}.{minor}.{patch}"

    def attitude(self) -> Attitude:
        """Returns the board's attitude."""
        roll, pitch, yaw = _unpacked("<3h", self.ask(ATTITUDE))
        return Attitude(roll / 10.0, pitch / 10.0, float(yaw))

    def raw_imu(self) -> RawImu:
        """Returns what the board's sensors show."""
        values = _unpacked("<9h", self.ask(RAW_IMU))
        return RawImu(values[:3], values[3:6], values[6:9])

    def motors(self) -> tuple[int, ...]:
        """Returns what the motors get, 1000 to 2000, and 0 for those that are not there, (8,)."""
        return _unpacked(f"<{MOTORS}H", self.ask(MOTOR))

    def status(self) -> Status:
        """Returns whether the board is armed, and why it cannot be."""
        return status_of(self.ask(STATUS_EX))

    def tuning(self) -> Tuning:
        """Returns what the board makes of its sticks."""
        numbers = _unpacked(_TUNING, self.ask(RC_TUNING))
        values = {name: str(value) for name, value in zip(_TUNED, numbers)}
        for name, words in (("rates_type", _RATES), ("throttle_limit_type", _LIMITS)):
            values[name] = dict(enumerate(words)).get(int(values[name]), "unknown")
        ranges = self.ask(MODE_RANGES)
        return Tuning(
            values,
            _unpacked("<4B", self.ask(RX_MAP)),
            tuple(
                (mode, channel, _FIRST + _STEP * low, _FIRST + _STEP * high)
                for mode, channel, low, high in zip(*4 * [iter(ranges)])
                if low < high
            ),
        )

    def heard(self) -> list[Frame]:
        """Returns the frames that have come since, without waiting for more.

        Raises:
            UserError: if the link is gone.
        """
        if not select.select([self._descriptor], [], [], 0.0)[0]:
            return []
        return list(self._decoder.feed(self._read()))

    def set_raw_rc(self, channels: Sequence[int]) -> None:
        """Moves the sticks: 1000 to 2000; roll, pitch, throttle, yaw, and switches. No answer."""
        self.tell(SET_RAW_RC, struct.pack(f"<{len(channels)}H", *channels))


def status_of(payload: bytes) -> Status:
    """Returns the status that an answer to STATUS_EX says."""
    cycle_time, _, _, modes = _unpacked("<3HI", payload)
    # After the profile, load and rate profile: how many more bytes of modes there are.
    more = _unpacked("<15xB", payload)[0] & 0x0F
    (reasons,) = _unpacked(f"<{16 + more + 1}xI", payload)
    return Status(cycle_time, modes, reasons)


def _unpacked(layout: str, payload: bytes) -> tuple:
    """Returns the numbers at the beginning of a payload; raises UserError if it is too short."""
    size = struct.calcsize(layout)
    if len(payload) < size:
        raise UserError("The board answers less than MSP says: it is another firmware.")
    return struct.unpack(layout, payload[:size])


@contextlib.contextmanager
def open_msp(place: str) -> Iterator[Msp]:
    """Opens a board's port, and closes it after the ``with`` block.

    Args: place: HOST:PORT of a firmware in software, or the file of a serial port.

    Raises:
        UserError: if it cannot be opened.
    """
    host, colon, port = place.rpartition(":")
    try:
        if colon and port.isdecimal():
            with socket.create_connection((host, int(port)), _PATIENCE) as connection:
                connection.setblocking(False)  # who does not read is no reason to wait
                yield Msp(connection.fileno())
            return
        descriptor = os.open(place, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError as e:
        raise UserError(_no_board(place, e.strerror or str(e))) from None
    try:
        try:
            tty.setraw(descriptor)
            speeds = termios.tcgetattr(descriptor)
            speeds[4] = speeds[5] = _BAUD
            termios.tcsetattr(descriptor, termios.TCSANOW, speeds)
        except termios.error as e:
            raise UserError(_no_board(place, e.args[-1])) from None
        yield Msp(descriptor)
    finally:
        os.close(descriptor)


def _no_board(place: str, why: str) -> str:
    return (
        f"There is no board at {place} ({why}): name HOST:PORT, or the file of a serial port such "
        "as /dev/ttyACM0."
    )
