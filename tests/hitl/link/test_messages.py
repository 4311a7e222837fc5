"""What goes through a message comes out as it was, to the last bit; nonsense does not."""

import dataclasses as dc
import struct
import zlib

import numpy as np
import pytest
from pydrake.math import RigidTransform

from airrace.hitl.link.packets import Dropped, pack, unpack
from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.trajopt.flat_trajectory import FlatTrajectory
from tests.hitl.link.messages import ROWS, STAMP, message_of, packed, values

BY_CHANNEL = {row.name: row for row in ROWS}


def same(a, b):
    """Whether two values are equal, deeply and exactly."""
    if isinstance(a, RigidTransform):
        return np.array_equal(a.GetAsMatrix34(), b.GetAsMatrix34())
    if isinstance(a, FlatTrajectory):
        times = np.linspace(0.0, a.duration, 50)
        return (
            a.breaks == b.breaks
            and np.array_equal(a.sample(times), b.sample(times))
            and all(
                same(vars(a)[name], vars(b)[name])
                for name in ("gate_times", "headings", "approach")
                if name in vars(a)
            )
        )
    if hasattr(a, "whole"):
        return np.array_equal(a.whole(), b.whole())
    if dc.is_dataclass(a):
        return type(a) is type(b) and all(
            same(getattr(a, f.name), getattr(b, f.name)) for f in dc.fields(a)
        )
    if isinstance(a, np.ndarray):
        return np.array_equal(a, b) and a.dtype == b.dtype
    if isinstance(a, (tuple, list)):
        return len(a) == len(b) and all(map(same, a, b))
    return a == b


@pytest.mark.parametrize("channel", list(BY_CHANNEL))
def test_round_trip(channel):
    row, given = BY_CHANNEL[channel], values()
    data = pack(message_of(row, given), STAMP)
    message, stamp = unpack(data, row.message_type)
    assert stamp == STAMP
    decoded = row.decode(message)
    assert set(decoded) == set(row.ports)
    for port in row.ports:
        assert same(given[port], decoded[port]), port


def test_no_plan_stays_the_one_that_there_is():
    row = BY_CHANNEL["AIRRACE_LAP_PLAN"]
    message, _ = unpack(pack(message_of(row, {"lap_plan": NO_PLAN}), STAMP), row.message_type)
    assert row.decode(message)["lap_plan"] is NO_PLAN


def test_every_value_is_checked_for_nan():
    """Each number of each message in turn is made NaN: none gets through."""
    checked = 0
    for row in ROWS:
        for path in number_paths(message_of(row)):
            message = message_of(row)
            set_at(message, path, float("nan"))
            with pytest.raises(Dropped):
                row.decode(message)
            checked += 1
    assert checked > 150


def number_paths(message, path=()):
    """Yields the ways to all floats in a message, but for its header."""
    for name in message.__slots__:
        value = getattr(message, name)
        if name == "header" or isinstance(value, (str, bytes, bool, int)):
            continue
        if isinstance(value, float):
            yield (*path, name)
        elif hasattr(value, "__slots__"):
            yield from number_paths(value, (*path, name))
        else:
            yield from item_paths(value, (*path, name))


def item_paths(items, path):
    for i, item in enumerate(items):
        if isinstance(item, float):
            yield (*path, i)
        elif hasattr(item, "__slots__"):
            yield from number_paths(item, (*path, i))
        elif isinstance(item, (list, tuple)):
            yield from item_paths(item, (*path, i))


def set_at(message, path, value):
    for step in path[:-1]:
        message = message[step] if isinstance(step, int) else getattr(message, step)
    if isinstance(path[-1], int):
        message[path[-1]] = value
    else:
        setattr(message, path[-1], value)


@pytest.mark.slow
@pytest.mark.parametrize("name", list(packed()))
def test_twenty_thousand_malformed_datagrams(name):
    """Torn, changed, and garbage: dropped, never raised; checksums that fit included."""
    data, message_type, decode = packed()[name]
    noise = np.random.Generator(np.random.PCG64(2))
    dropped = 0
    for k in range(20_000):
        bad = malformed(data, k, noise)
        try:
            message, _ = unpack(bad, message_type)
            decode(message)
        except Dropped:
            dropped += 1
    # What has a right checksum and right sizes may be other numbers, which nobody can tell.
    assert dropped > 15_000


def malformed(data, k, noise):
    """Returns bytes that are not a sound message, in one of several ways."""
    kind = k % 5
    if kind == 0:
        return data[: noise.integers(len(data))]
    if kind == 1:
        return data + noise.bytes(int(noise.integers(1, 50)))
    if kind == 2:
        return noise.bytes(int(noise.integers(0, 300)))
    bad = bytearray(data)
    for _ in range(int(noise.integers(1, 4))):
        bad[noise.integers(len(bad))] ^= int(noise.integers(1, 256))
    # A sender that means it has the right checksum: then it is up to the decoders.
    return bytes(bad) if kind == 3 else resealed(bytes(bad))


def resealed(data: bytes) -> bytes:
    """Returns a message with the checksum that its bytes have."""
    return (
        data[:8] + struct.pack(">I", zlib.crc32(data[12:])) + data[12:] if len(data) > 12 else data
    )
