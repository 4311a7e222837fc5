"""Reads the log of a flight controller: Betaflight's blackbox.

A log is lines that begin with ``H``, which say what its fields are, and frames, each a letter and
the fields' numbers in as few bytes as they need. An ``I`` frame stands for itself; a ``P`` frame
says how its fields differ from what the two frames before it lead to expect. Both are described
by Betaflight's blackbox_fielddefs.h and blackbox_encoding.c.
"""

from collections.abc import Iterator
from pathlib import Path

import pandas as pd

# Encodings of fields.
_SIGNED, _UNSIGNED, _NEGATIVE_14, _TAG8_8, _TAG2_3, _TAG8_4, _NULL, _TAG2_3_VARIABLE = (
    0, 1, 3, 6, 7, 8, 9, 10
)  # fmt: skip
_GROUPS = {_TAG8_8: 8, _TAG2_3: 3, _TAG8_4: 4, _TAG2_3_VARIABLE: 3}  # fields that share a tag
# Of three fields that share a tag, by its upper two bits: how many bytes come after the tag, and of
# each field the place, from the right, and the number of bits.
_PACKED = {
    (_TAG2_3, 0): (0, ((4, 2), (2, 2), (0, 2))),
    (_TAG2_3, 1): (1, ((8, 4), (4, 4), (0, 4))),
    (_TAG2_3, 2): (2, ((16, 6), (8, 6), (0, 6))),
    (_TAG2_3_VARIABLE, 0): (0, ((4, 2), (2, 2), (0, 2))),
    (_TAG2_3_VARIABLE, 1): (1, ((9, 5), (4, 5), (0, 4))),
    (_TAG2_3_VARIABLE, 2): (2, ((14, 8), (7, 7), (0, 7))),
}
# What a field is expected to be.
_PREVIOUS, _LINE, _AVERAGE, _FIRST_MOTOR, _NEXT, _MIDDLE, _LEAST_MOTOR = 1, 2, 3, 5, 6, 8, 11
_EVENT_NUMBERS = {0: 1, 14: 2, 15: 1, 30: 2}  # of events, how many numbers follow
_SECOND = 1e6  # us
FILE = "betaflight.bfl"  # of a race's folder
RACE_BEGINS = 6.7  # s of the firmware's clock, by when it has been started, calibrated and armed


class _Bytes:
    """Takes numbers from the bytes of a log."""

    def __init__(self, data: bytes, at: int):
        self.data, self.at = data, at

    def byte(self) -> int:
        value = self.data[self.at]
        self.at += 1
        return value

    def unsigned(self) -> int:
        value = shift = 0
        while True:
            byte = self.data[self.at]
            self.at += 1
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                return value
            shift += 7
            if shift > 35:
                raise ValueError("a number that does not end")

    def signed(self) -> int:
        value = self.unsigned()
        return (value >> 1) ^ -(value & 1)

    def little(self, size: int) -> int:
        value = int.from_bytes(self.data[self.at : self.at + size], "little", signed=True)
        self.at += size
        return value

    def group(self, encoding: int, count: int) -> list[int]:
        """Returns the values of fields that share a tag."""
        if encoding == _TAG8_8:
            if count == 1:
                return [self.signed()]
            tag = self.byte()
            return [self.signed() if tag >> i & 1 else 0 for i in range(count)]
        return self._four() if encoding == _TAG8_4 else self._three(encoding)

    def _three(self, encoding: int) -> list[int]:
        tag = self.byte()
        if tag >> 6 == 3:
            return [self.little(1 + (tag >> 2 * i & 3)) for i in range(3)]
        more, places = _PACKED[encoding, tag >> 6]
        bits = tag
        for _ in range(more):
            bits = bits << 8 | self.byte()
        return [_signed(bits >> shift, size) for shift, size in places]

    def _four(self) -> list[int]:
        tag, values = self.byte(), []
        half: int | None = None  # the lower four bits of a byte whose upper ones are used

        def nibble() -> int:
            nonlocal half
            if half is None:
                byte = self.byte()
                half = byte & 15
                return byte >> 4
            value, half = half, None
            return value

        for i in range(4):
            size = (0, 1, 2, 4)[tag >> 2 * i & 3]
            value = 0
            for _ in range(size):
                value = value << 4 | nibble()
            values.append(_signed(value, 4 * size) if size else 0)
        return values


def _signed(value: int, bits: int) -> int:
    """Returns the lowest bits of a number as a number in two's complement."""
    value &= (1 << bits) - 1
    return value - (1 << bits) if value >> (bits - 1) else value


class _Frames:
    """The fields of a kind of frame, and how each is written."""

    def __init__(self, head: dict[str, str], kind: str, names: list[str]):
        self.names = names
        self.predictors = _numbers(head[f"Field {kind} predictor"])
        self.encodings = _numbers(head[f"Field {kind} encoding"])
        if not len(names) == len(self.predictors) == len(self.encodings):
            raise ValueError("fields whose numbers differ")

    def values(self, source: _Bytes) -> list[int]:
        """Returns what is written of each field."""
        values: list[int] = []
        while len(values) < len(self.names):
            encoding = self.encodings[len(values)]
            if encoding in _GROUPS:
                count = 0
                for each in self.encodings[len(values) : len(values) + _GROUPS[encoding]]:
                    if each != encoding:
                        break
                    count += 1
                values += source.group(encoding, count)[:count]
            elif encoding == _SIGNED:
                values.append(source.signed())
            elif encoding == _UNSIGNED:
                values.append(source.unsigned())
            elif encoding == _NEGATIVE_14:
                values.append(-_signed(source.unsigned(), 14))
            elif encoding == _NULL:
                values.append(0)
            else:
                raise ValueError("an encoding that is not known")
        return values


def _numbers(text: str) -> list[int]:
    return [int(each) for each in text.split(",")]


def read_blackbox(path: Path) -> pd.DataFrame:
    """Returns the frames of a log: ``time`` (s, of its own clock), and its fields by their names.

    Set-points and gyroscope are in deg/s, motors in the units of their outputs. What comes after
    something that cannot be read is left out.

    Raises:
        OSError: if the file cannot be read.
        ValueError: if it is no such log.
    """
    data = path.read_bytes()
    head, at = _head(data)
    try:
        names = head["Field I name"].split(",")
        least = _numbers(head["motorOutput"])[0]
        kinds = {ord(kind): _Frames(head, kind, names) for kind in "IP"}
        slow = _Frames(head, "S", head["Field S name"].split(","))
    except KeyError as e:
        raise ValueError(f"it does not say its {e}") from None
    if "time" not in names or len({*names}) < len(names):
        raise ValueError("its fields have no names of their own")
    rows = []
    try:
        for row in _rows(_Bytes(data, at), kinds, slow, least):
            rows.append(row)
    except (IndexError, ValueError):  # it ends in the middle of a frame, or is damaged there
        pass
    frames = pd.DataFrame(rows, columns=names, dtype=float)
    frames["time"] /= _SECOND
    return frames


def _head(data: bytes) -> tuple[dict[str, str], int]:
    """Returns what the lines at the beginning say, and where they end."""
    head, at = {}, 0
    while data.startswith(b"H ", at):
        end = data.find(b"\n", at)
        if end < 0:
            break
        name, _, value = data[at + 2 : end].decode("latin-1").partition(":")
        head[name], at = value.strip(), end + 1
    if "blackbox" not in head.get("Product", "").lower():
        raise ValueError("it is no log of a blackbox")
    return head, at


def _rows(
    source: _Bytes, kinds: dict[int, _Frames], slow: _Frames, least: int
) -> Iterator[list[int]]:
    """Yields the values of all fields, frame after frame."""
    before: list[list[int]] = []  # two rows, newest first
    while source.at < len(source.data):
        kind = source.byte()
        if kind in kinds:
            frames = kinds[kind]
            row = _expected(frames, frames.values(source), before, least)
            before = [row, row if kind == ord("I") else before[0]]
            yield row
        elif kind == ord("S"):
            slow.values(source)
        elif kind == ord("E"):
            event = source.byte()
            for _ in range(_EVENT_NUMBERS[event] if event in _EVENT_NUMBERS else 1 << 30):
                source.unsigned()
        else:
            raise ValueError("a frame that is not known")


def _expected(frames: _Frames, values: list[int], before: list[list[int]], least: int) -> list[int]:
    """Adds to what is written what the fields were expected to be."""
    first_motor = frames.names.index("motor[0]")
    row: list[int] = []
    for i, (predictor, value) in enumerate(zip(frames.predictors, values)):
        if predictor == _PREVIOUS:
            value += before[0][i]
        elif predictor == _LINE:
            value += 2 * before[0][i] - before[1][i]
        elif predictor == _AVERAGE:
            value += int((before[0][i] + before[1][i]) / 2)
        elif predictor == _FIRST_MOTOR:
            value += row[first_motor]
        elif predictor == _NEXT:
            value += before[0][i] + 1
        elif predictor == _MIDDLE:
            value += 1500
        elif predictor == _LEAST_MOTOR:
            value += least
        elif predictor != 0:
            raise ValueError("a prediction that is not known")
        row.append(value)
    return row
