"""LCM's format: there and back, and nothing that a datagram claims is believed."""

import random
import struct
import tracemalloc

import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.hitl.link.datagrams import INCOMPLETE, LARGEST, OTHER, REST, Assembler, datagrams
from airrace.hitl.link.packets import MALFORMED, OVERSIZED

CHANNEL = "AIRRACE_CAMERA"
LIMIT = 1 << 20
LONG = bytes(range(256)) * 800  # four fragments


@pytest.fixture
def assembler():
    made = Assembler()
    made.limits[CHANNEL] = LIMIT
    made.limits["AIRRACE_SMALL"] = 64
    return made


def take(assembler, datagram, sender="one"):
    return assembler.take(memoryview(datagram), sender)


def fragment(body=b"", size=100_000, offset=0, index=0, count=2, number=1):
    return struct.pack(">4sIIIHH", b"LC03", number, size, offset, index, count) + body


def first(body=b"", channel=CHANNEL, **claims):
    return fragment(channel.encode() + b"\0" + body, **claims)


@given(size=st.integers(0, 1 << 18), trailer=st.sampled_from([0, 32]), seed=st.integers(0, 99))
def test_there_and_back(size, trailer, seed):
    assembler, data = Assembler(trailer), random.Random(seed).randbytes(size)
    assembler.limits[CHANNEL] = LIMIT
    parts = list(datagrams(CHANNEL, data, seed, trailer))
    assert max(map(len, parts)) + trailer <= 65507  # what UDP over IPv4 carries
    *before, last = [take(assembler, part) for part in parts]
    assert not any(before) and last == (CHANNEL, data)
    assert not assembler.dropped and not assembler._partial


# What a datagram is, and why it is dropped; with a cut name, liblcm 1.5.3 ends the process.
DATAGRAMS = [
    (b"", MALFORMED),
    (b"LC02", MALFORMED),
    (b"LC04\0\0\0\1" + b"AIRRACE_CAMERA\0", MALFORMED),
    (b"LC02\0\0\0\1AIRRACE_CAM", MALFORMED),
    (b"LC02\0\0\0\1", MALFORMED),
    (b"LC02\0\0\0\1" + b"A" * 300 + b"\0", MALFORMED),
    (b"LC02\0\0\0\1XIRRACE_CAMERA\0", OTHER),
    (b"LC02\0\0\0\1\xff\xfe\0", OTHER),
    (b"LC02\0\0\0\1AIRRACE_SMALL\0" + bytes(65), OVERSIZED),
    (fragment()[:-1], MALFORMED),
    (fragment(b"AIRRACE_CAM"), MALFORMED),
    (first(size=0x0FFFFFFF, count=1), OVERSIZED),  # a message of 256 MB
    (first(size=0xFFFFFFFF), OVERSIZED),
    (first(size=65, channel="AIRRACE_SMALL"), OVERSIZED),
    (first(channel="ANOTHER"), OTHER),
    (first(count=0), MALFORMED),
    (first(count=65535), MALFORMED),
    (first(bytes(100), size=99, count=1), MALFORMED),
    (first(bytes(98), size=99, count=1), MALFORMED),
    (first(b"x", offset=0xFFFFFFF0), MALFORMED),
    (first(b"x", offset=4, count=1), MALFORMED),
    (fragment(b"x", index=1), REST),
    (fragment(b"x", size=5, index=1, count=65535), MALFORMED),
]


@pytest.mark.parametrize("datagram, reason", DATAGRAMS)
def test_what_is_dropped(assembler, datagram, reason):
    for _ in range(100):
        assert take(assembler, datagram) is None
    assert dict(assembler.dropped) == {reason: 100}
    assert take(assembler, next(datagrams(CHANNEL, b"sound", 1))) == (CHANNEL, b"sound")


@pytest.mark.parametrize(
    "change",
    [
        {"offset": 65472 + 1},
        {"offset": 0},
        {"offset": 0xFFFFFFF0},
        {"index": 7},
        {"index": 2},
        {"index": 0xFFFF},
        {"count": 3},
        {"size": 99_999},
        {"number": 2},
    ],
)
def test_what_does_not_belong_to_a_message_does_not_end_it(assembler, change):
    """A second fragment that lies; the true one still makes the message, unless it was taken."""
    data = bytes(100_000)
    one, two = datagrams(CHANNEL, data, 1)
    claims = {"size": 100_000, "offset": len(data) - (len(two) - 20), "index": 1, "number": 1}
    assert take(assembler, one) is None
    assert take(assembler, fragment(two[20:], **{**claims, **change})) is None
    assert assembler.dropped.total() == 1
    if change.get("offset", 1):
        assert take(assembler, two) == (CHANNEL, data)


def test_the_next_message_of_a_sender_ends_the_wait_of_its_last(assembler):
    torn, whole = (list(datagrams(CHANNEL, LONG, number)) for number in (1, 2))
    for part in torn[:-1]:
        assert take(assembler, part) is None
    for part in torn[:2]:  # another sender's, at the same time
        assert take(assembler, part, "two") is None
    *_, last = [take(assembler, part) for part in whole]
    assert last == (CHANNEL, LONG) and assembler.dropped == {INCOMPLETE: 1}
    assert take(assembler, torn[-1]) is None
    *_, last = [take(assembler, part, "two") for part in torn[2:]]
    assert last == (CHANNEL, LONG)


def test_beginnings_without_an_end_take_bounded_memory(assembler):
    tracemalloc.start()
    for sender in range(2000):
        take(assembler, next(datagrams(CHANNEL, LONG, 1)), sender)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 3_000_000 and assembler.dropped[INCOMPLETE] == 2000 - 16


def test_claims_take_no_memory_and_no_time(assembler):
    tracemalloc.start()
    for _ in range(10_000):
        take(assembler, first(size=LIMIT, count=1))
    assert tracemalloc.get_traced_memory()[1] < 500_000
    tracemalloc.stop()
    assert LARGEST < LIMIT


def test_fragments_that_overlap_take_no_more_than_their_message(assembler):
    """Each is at the message's begin; together they would be many times as long."""
    for sender in range(4):
        take(assembler, first(bytes(60_000), size=LIMIT, count=900), sender)
        for index in range(1, 900):
            take(assembler, fragment(bytes(60_000), LIMIT, 0, index, 900), sender)
    held = [
        sum(len(data) for _, data in each.parts.values()) for each in assembler._partial.values()
    ]
    assert len(held) == 4 and max(held) <= LIMIT


def test_the_rest_of_a_message_on_a_channel_that_is_left(assembler):
    one, *others = datagrams(CHANNEL, LONG, 1)
    take(assembler, one)
    assembler.ignore(CHANNEL)
    for part in others:
        assert take(assembler, part) is None
    assert assembler.dropped == {REST: len(others)}
