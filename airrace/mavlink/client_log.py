"""What a client and the simulator say to each other, as a file and a line a second."""

import collections
import struct
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO, Self

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from airrace.common.errors import UserError, words
from airrace.recording import race_events as events

FILE = "race.tlog"
# Names of messages by the three bytes of their type.
_NAMES = {
    kind.to_bytes(3, "little"): message.msgname for kind, message in mavlink.mavlink_map.items()
}
_MOST_NAMED = 3  # types of messages that a line names


class ClientLog:
    """A sink and a link's tap: writes every MAVLink message of both sides to a file.

    The file is a tlog, as ground stations have it: before each message its time in microseconds,
    eight bytes, big-endian. Times are simulated. After each second of them, a line says what came,
    what was sent, and how the race stands.
    """

    def __init__(self, path: Path, note: Callable[[str], object]):
        """Opens the file; note: shows a line. Raises UserError if it cannot be written."""
        self._note, self._time, self._place = note, 0.0, ""
        self._said, self._heard = 0, collections.Counter[str]()
        self._gates, self._state = 0, "ON_PAD"
        self._path, self._is_whole = path, True
        try:
            self._file: BinaryIO = path.open("wb")
        except OSError as e:
            raise UserError(f"{path}: {words(e)}; name another folder.") from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        try:
            self._file.close()  # which writes what is left
        except OSError as e:
            self._give_up(e)

    def tap(self, time: float, sent: bool, data: bytes) -> None:
        """Writes a message of a time (s); sent: by the simulator, or by the client."""
        try:
            if self._is_whole:
                self._file.write(struct.pack(">Q", round(1e6 * time)) + data)
        except OSError as e:
            self._give_up(e)
        if sent:
            self._said += 1
        else:
            self._heard[_NAMES.get(data[7:10], "MAVLink 1")] += 1

    def take(self, event: events.RaceEvent) -> None:
        """Takes in what has happened, and once a second, says so."""
        if int(event.time) != int(self._time):
            self._tell(event.time)
        self._time = event.time
        match event:
            case events.ExplorerChanged():
                self._state = event.status.state
            case events.GateCrossed():
                self._gates += 1
            case events.StateSample():
                x, y, z = event.truth.position
                speed = float(np.linalg.norm(event.truth.velocity))
                self._place = f" at ({x:.1f} {y:.1f} {z:.1f}) m, {speed:.1f} m/s"

    def _give_up(self, error):
        """Says that the file ends here; the race goes on."""
        if self._is_whole:
            self._note(f"{self._path} cannot be written any more ({words(error)}): it ends here.")
        self._is_whole = False

    def _tell(self, time):
        most = self._heard.most_common(_MOST_NAMED)
        heard = ", ".join(f"{count} {name}" for name, count in most) or "nothing"
        rest = sum(self._heard.values()) - sum(count for _, count in most)
        heard += f" and {rest} more" if rest else ""
        stands = f"{self._state}, {self._gates} gates{self._place}"
        self._note(f"[{time:7.1f} s] {stands}; heard {heard}; told {self._said}")
        self._said = 0
        self._heard.clear()
