"""The ssh connection is lost while the autonomy runs: it runs on, and nothing is lost."""

import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

from airrace.common.errors import UserError
from airrace.common.patience import patient
from airrace.hitl.companion import ssh
from airrace.hitl.companion.ssh_companion import SshCompanion
from tests.hitl.companion.conftest import ADDRESS
from tests.hitl.companion.tiny_autonomy import start

LOST = "airrace: the ssh connection was lost; the race goes on as long as its messages come"


@pytest.fixture
def impatient(monkeypatch):
    """Connections that are given up after 1.2 s of silence instead of 20 s."""
    monkeypatch.setattr(ssh, "_KEEPALIVE", 0.3)
    monkeypatch.setattr(ssh, "_CONNECT_TIMEOUT", 0.5)


def programs(hosts, word):
    """Returns the processes on the companion that have a word in their command line."""
    pids = subprocess.run(
        ["ip", "netns", "pids", hosts.companion], capture_output=True, text=True
    ).stdout.split()
    return [int(pid) for pid in pids if word in _command_line(pid)]


def _command_line(pid):
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    except OSError:
        return ""


def cut_connections(hosts):
    """Kills the server's side of all ssh connections, but not the server."""
    for pid in programs(hosts, "sshd: root"):
        os.kill(pid, signal.SIGKILL)


def test_runs_on_and_is_stopped_through_another_connection(hosts, companion, tmp_path):
    if hosts.server != "sshd":
        pytest.skip("one connection of sshd's can be killed, and there is no sshd")
    autonomy, log = start(companion, "talk")
    cut_connections(hosts)
    log.wait(autonomy, LOST)
    assert autonomy.poll() is None
    assert len(programs(hosts, "-m airrace hitl autonomy")) == 1
    (written,) = hosts.home.glob(".cache/airrace/runs/*/output/autonomy.log")
    size = written.stat().st_size
    time.sleep(0.2)
    assert written.stat().st_size > size
    autonomy.stop()
    assert autonomy.poll() == -1
    assert not programs(hosts, "airrace hitl autonomy")
    autonomy.collect(tmp_path)
    lines = (tmp_path / "autonomy.log").read_text().splitlines()
    assert lines[:3] == log[:3] and lines[-1].startswith("line ")
    companion.close()
    assert not list((hosts.home / ".cache/airrace/runs").iterdir())


@pytest.mark.slow
def test_pulled_for_a_moment(hosts, companion):
    autonomy, log = start(companion, "talk")
    hosts.cable(plugged=False)
    time.sleep(0.5)
    hosts.cable(plugged=True)
    seen = len(log)
    log.until(autonomy, lambda: len(log) > seen + 20, 20.0)
    assert LOST not in log
    autonomy.stop()
    assert autonomy.poll() == 1


@pytest.mark.slow
def test_pulled_for_good(hosts, companion, checkout, impatient, tmp_path):
    start(companion, "farewell")  # sets up, before the clock of anything ticks
    companion.close()
    companion = SshCompanion(ADDRESS, checkout=checkout[0])
    autonomy, log = start(companion, "talk")
    hosts.cable(plugged=False)
    try:
        log.wait(autonomy, LOST)
        autonomy.stop(timeout=0.1)
        assert autonomy.poll() == -1
        with pytest.raises(UserError, match="cannot be fetched .*; it is in .*/runs/.*") as e:
            autonomy.collect(tmp_path)
        assert str(e.value).count("\n") == 0
        companion.close()
    finally:
        hosts.cable(plugged=True)
    # What could not be fetched is still there, and the autonomy ends by itself.
    (folder,) = (hosts.home / ".cache/airrace/runs").iterdir()
    assert str(folder) in str(e.value)
    (folder / "output/silence").touch()
    deadline = time.monotonic() + patient(10.0)
    while programs(hosts, "airrace hitl autonomy"):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    assert (folder / "output/map/map.json").read_text() == "[1]"


def test_lost_in_the_set_up(hosts, checkout, impatient):
    companion = SshCompanion(ADDRESS, checkout=checkout[0])
    companion.connection()
    hosts.cable(plugged=False)
    try:
        with pytest.raises(UserError, match="ssh connection to 10.0.0.2 was lost .* start again"):
            companion.start([], {}, print)
    finally:
        hosts.cable(plugged=True)
    companion.close()
