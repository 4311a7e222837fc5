"""What an entry writes: kept within limits, and not to be taken back."""

import os

from airrace.league.attempts import MARK
from airrace.league.sandbox import EntryLog


def log_of(data):
    reader, writer = os.pipe()
    log = EntryLog(open(reader, "rb"))
    with open(writer, "wb") as file:
        file.write(data)
    log.wait()
    return log


def test_lines_and_attempts(tmp_path):
    log = log_of(f"a\n\n{MARK}read x\n  b \xff\n{MARK}read x\n{MARK}forked\nc".encode("latin-1"))
    assert log.lines == ["a", "b \ufffd", "c"]
    assert log.attempts == ["read x", "forked"]
    log.save(tmp_path / "log")
    assert (tmp_path / "log").read_text() == "a\nb \ufffd\nc\n"


def test_much_of_it():
    marks = "".join(f"{MARK}{i}\n" for i in range(100))
    log = log_of(f"{marks}{'x' * 10**6}\n{'last\n' * 1000}".encode())
    assert log.attempts == [str(i) for i in range(50)]
    assert log.lines == ["last"] * 200
