"""What `airrace doctor` says of this computer; the link's part is in tests/diagrams/test_hitl.py."""

import contextlib
from unittest.mock import Mock

from airrace.betaflight import firmware, firmware_process
from airrace.commands import computer_checks
from airrace.commands.app import main
from airrace.commands.computer_checks import check_computer
from airrace.hitl.link.doctor import BAD, GOOD, WEAK


def verdict(what: str) -> str:
    return next(row.verdict for row in check_computer() if row.what == what)


def test_a_computer_that_runs_the_tests_can_race(capsys):
    assert main(["doctor"]) == 0
    text = capsys.readouterr().out
    assert "This computer" in text and "pydrake" in text and "free disk here" in text


def test_what_is_missing_is_found(monkeypatch, capsys):
    monkeypatch.setattr(computer_checks, "_PACKAGES", ("pydrake", "no_such_package"))
    assert verdict("no_such_package") == BAD
    assert main(["doctor"]) == 1
    monkeypatch.setattr(computer_checks, "processors", lambda: 1)
    assert verdict("processors") == WEAK
    monkeypatch.setattr(
        computer_checks, "real_time_priority", lambda: contextlib.nullcontext(False)
    )
    assert verdict("real-time priority") == WEAK
    monkeypatch.setattr(computer_checks.jit, "is_complete", lambda what: False)
    assert verdict("inner loops compiled") == WEAK
    usage = computer_checks.shutil.disk_usage(".")._replace(free=1e6)
    monkeypatch.setattr(computer_checks.shutil, "disk_usage", lambda path: usage)
    assert verdict("free disk here") == BAD


def test_a_firmware_that_is_slow_is_said(monkeypatch):
    monkeypatch.setattr(firmware, "find_firmware", Mock())
    for steps, in_time, verdicts in ((2e3, 0.9, (WEAK, WEAK)), (2e4, 1.0, (GOOD, GOOD))):
        pace = firmware_process.Pace(steps, in_time, 1e-4)
        monkeypatch.setattr(firmware_process, "measure_pace", lambda _, pace=pace: pace)
        assert (verdict("Betaflight alone"), verdict("Betaflight in real time")) == verdicts
