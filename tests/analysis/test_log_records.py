"""A damaged log says so, and is read as far as it is whole."""

import zlib

import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk, Schema

from airrace.analysis.log import log_damage, read_attachments, read_log
from airrace.recording import foxglove_messages
from airrace.recording.writer import RaceLog

COUNT = 40


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The bytes of a log with a chunk for each of its messages, and an attachment."""
    path = tmp_path_factory.mktemp("log") / "race.mcap"
    log = RaceLog(path)
    log.attach("track.yaml", "name: hexagon")
    for k in range(COUNT):
        log.write("/explorer", float(k), foxglove_messages.log(float(k), "HOVER", "looking"))
        log.flush()
    log.close()
    return path.read_bytes()


def places(data):
    """Opcodes of the records of a log, and where they begin."""
    at = 8
    while at < len(data) - 8:
        yield data[at], at
        at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")


@pytest.fixture
def left(tmp_path):
    """Writes the bytes of a log; returns the times (s) of what is left, and the damage."""

    def read(data):
        path = tmp_path / "race.mcap"
        path.write_bytes(data)
        return [round(time) for _, time, _ in read_log(path)], log_damage(path)

    return read


def test_a_whole_log_has_no_damage(whole, left):
    assert left(whole) == ([*range(COUNT)], None)


def test_one_flipped_bit_costs_one_chunk_at_most_and_is_said(whole, left):
    end = dict(places(whole))[15]  # of the data
    silent = []
    for place in range(60, end, max(1, end // 150)):
        data = bytearray(whole)
        data[place] ^= 0x10
        times, damage = left(bytes(data))
        assert len(times) >= COUNT - 1 and set(times) <= set(range(COUNT))
        if damage is None:
            assert len(times) == COUNT
            silent.append(place)
        elif len(times) < COUNT:
            assert "race.mcap is damaged at" in damage and f"39 of {COUNT} messages are" in damage
    # In an index or a time that nobody reads.
    assert len(silent) < 110


def test_without_a_summary_it_is_read_in_sequence(whole, left):
    data = bytearray(whole)
    data[-20] ^= 1  # of the footer
    times, damage = left(bytes(data))
    assert times == [*range(COUNT)] and "are left" in damage


def test_a_killed_race_has_no_damage(whole, left):
    for size in range(100, dict(places(whole))[15], 400):
        times, damage = left(whole[:size])
        assert times == [*range(len(times))] and damage is None


def test_a_damaged_attachment_is_left_out(whole, left, tmp_path):
    place = whole.index(b"name: hexagon")
    _, damage = left(whole[:place] + b"N" + whole[place + 1 :])
    assert "damaged at" in damage and read_attachments(tmp_path / "race.mcap") == {}
    left(whole)
    assert read_attachments(tmp_path / "race.mcap") == {"track.yaml": "name: hexagon"}


def chunk(data, size, compression="zstd", crc=0):
    builder = RecordBuilder()
    Chunk(compression, data, 0, 0, crc, size).write(builder)
    return builder.end()


def schema(size):
    """A record that is right but for its size."""
    builder = RecordBuilder()
    Schema(data=bytes(size), encoding="", id=999, name="").write(builder)
    return builder.end()


ZEROS = bytes(60_000_003)  # records of nine bytes, of no kind
LONG = schema(64_000_001)
BOMBS = {
    "more than it may": lambda: chunk(zstandard.compress(LONG), len(LONG)),
    "records of nothing": lambda: chunk(zstandard.compress(ZEROS), len(ZEROS)),
    "more than it says": lambda: chunk(zstandard.compress(ZEROS), 1000),
    "less than it says": lambda: chunk(zstandard.compress(ZEROS[:1000]), 60_000_000),
    "a claim": lambda: chunk(zstandard.compress(b"")[:4] + b"\xff" * 40, 10**10),
    "another compression": lambda: chunk(schema(9), len(schema(9)), "lz4"),
    "a checksum": lambda: chunk(b"abc", 3, "", zlib.crc32(b"abd")),
    "a long record": lambda: b"\x06" + (1 << 62).to_bytes(8, "little"),
}


@pytest.mark.parametrize("bomb", BOMBS.values(), ids=BOMBS)
def test_a_bomb_is_left_out_and_said(whole, left, bomb):
    """Put before the first chunk of a log that was not closed."""
    begin, end = (next(at for code, at in places(whole) if code == wanted) for wanted in (6, 15))
    made = bomb()
    times, damage = left(whole[:begin] + made + whole[begin:end])
    assert "damaged at" in damage
    assert times == ([] if made[-1] == 0x40 else [*range(COUNT)])
