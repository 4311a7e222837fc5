"""Signed datagrams: whose they are, and that each counts once."""

import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.common.errors import UserError
from airrace.hitl.link.link_key import TRAILER, UNSIGNED, Seal, read_key
from airrace.hitl.link.packets import REPLAYED, Dropped
from tests.worlds.cases import guarded

KEY = bytes(range(32))


@pytest.fixture
def ends():
    return Seal(KEY), Seal(KEY)


def reason_of(seal, datagram):
    with pytest.raises(Dropped) as e:
        seal.opened(memoryview(datagram))
    return e.value.args[0]


@guarded
@given(data=st.binary(max_size=100), at=st.integers(0, 131), bit=st.integers(0, 7))
def test_sealed_and_changed(data, at, bit):
    one, other = Seal(KEY), Seal(KEY)
    sealed = one.sealed(data)
    changed = bytearray(sealed)
    changed[at % len(sealed)] ^= 1 << bit
    assert reason_of(other, bytes(changed)) == UNSIGNED
    assert bytes(other.opened(memoryview(sealed))[0]) == data
    assert len(sealed) == len(data) + TRAILER


def test_foreign_short_and_unsigned(ends):
    one, other = ends
    for foreign in (b"", b"x" * (TRAILER - 1), b"x" * 100, Seal(KEY[::-1]).sealed(b"data")):
        assert reason_of(other, foreign) == UNSIGNED
    assert reason_of(other, one.sealed(b"data")[1:]) == UNSIGNED


def test_each_counts_once_and_late_ones_do_not_count(ends):
    one, other = ends
    sent = [one.sealed(b"%d" % k) for k in range(3000)]
    for k in (1, 0, 2, 2000, 1500, 2999):  # overtaken ones count
        assert bytes(other.opened(memoryview(sent[k]))[0]) == b"%d" % k
    for k in (0, 1, 2, 2000, 1500, 2999, 1000):  # but the last: older than the window
        assert reason_of(other, sent[k]) == REPLAYED
    assert other.opened(memoryview(sent[2998]))[1] == one._own
    third = Seal(KEY)  # its numbers are its own
    assert bytes(other.opened(memoryview(third.sealed(b"third")))[0]) == b"third"


def test_what_is_not_signed_is_not_remembered(ends):
    one, other = ends
    sealed = bytearray(one.sealed(b"data"))
    sealed[-TRAILER + 8] = 0xFF  # a number far ahead
    assert reason_of(other, bytes(sealed)) == UNSIGNED and not other._heard
    for _ in range(200):
        other.opened(memoryview(Seal(KEY).sealed(b"")))
    assert len(other._heard) == 64


@pytest.mark.parametrize(
    "size, mode, sentence",
    [
        (32, 0o644, "is open to others: chmod 600"),
        (32, 0o620, "is open to others"),
        (31, 0o600, "is no file of 32 to 65536 bytes; .*urandom"),
        (70_000, 0o600, "is no file of"),
    ],
)
def test_keys_that_are_refused(tmp_path, size, mode, sentence):
    path = tmp_path / "key"
    path.write_bytes(bytes(size))
    path.chmod(mode)
    with pytest.raises(UserError, match=f"--link_key .* {sentence}"):
        read_key(path)


def test_what_is_no_file_of_a_key(tmp_path):
    os.mkfifo(tmp_path / "pipe", 0o600)
    for path in (tmp_path / "none", tmp_path, "/dev/zero", tmp_path / "pipe", "a\0b"):
        with pytest.raises(UserError, match="--link_key .*urandom"):
            read_key(type(tmp_path)(path))
    path = tmp_path / "key"
    os.close(os.open(path, os.O_CREAT, 0o600))
    path.write_bytes(KEY)
    assert read_key(path) == KEY
