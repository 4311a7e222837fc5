"""The autonomy over ssh, from one network namespace to another."""

import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from airrace.common.errors import UserError
from airrace.hitl.companion.set_up import LOCK
from airrace.hitl.companion.ssh_companion import SshCompanion
from tests.hitl.companion.conftest import ADDRESS
from tests.hitl.companion.tiny_autonomy import start
from tests.hitl.companion.two_hosts import TwoHosts


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def runs(hosts):
    return list((hosts.home / ".cache/airrace/runs").iterdir())


@pytest.mark.slow
def test_runs_and_brings_its_files_back(companion, hosts, tmp_path):
    files = {
        "scenario.yaml": b"laps: 1\n",
        "my_team.py": b"WORD = 'ours'\n",
        "drone/vehicle.yaml": bytes(range(256)) * 10_000,
    }
    autonomy, log = start(companion, "module", files=files)
    log.wait(autonomy, "ours")
    (folder,) = runs(hosts)
    assert (folder / "drone/vehicle.yaml").read_bytes() == files["drone/vehicle.yaml"]
    assert (folder / "my_team.py").stat().st_mode & 0o777 == 0o600  # as a key must be
    assert autonomy.poll() is None
    autonomy.stop()
    assert autonomy.poll() == 1
    autonomy.stop()  # again: nothing
    autonomy.collect(tmp_path / "autonomy")
    assert (tmp_path / "autonomy/map/map.json").read_text() == "[1]"
    assert (tmp_path / "autonomy/autonomy.log").read_text().splitlines() == log
    companion.close()
    assert not runs(hosts)


@pytest.mark.repeats
def test_another_ssh_server(companion, hosts, checkout, tmp_path, monkeypatch):
    """The same with the server of asyncssh, where the other tests have sshd."""
    start(companion, "farewell")
    companion.close()
    with TwoHosts(tmp_path / "hosts", "asyncssh", hosts.home) as others:
        shutil.copytree(hosts.path, others.path, symlinks=True, dirs_exist_ok=True)
        monkeypatch.setenv("HOME", str(others.ssh.parent))
        with others.on_workstation():
            autonomy, log = start(companion, "talk", "worker", files={"a/b": b"1"})
            autonomy.stop()
            assert autonomy.poll() == 1
            autonomy.collect(tmp_path / "out")
            companion.close()
    assert (tmp_path / "out/autonomy.log").read_text().splitlines()[:3] == log[:3]
    assert not runs(hosts)


def test_the_board_waits_as_long_as_the_workstation(companion, hosts, monkeypatch):
    monkeypatch.setenv("AIRRACE_PATIENCE", "20")
    start(companion, "farewell")
    (folder,) = runs(hosts)
    assert "AIRRACE_PATIENCE=20.0" in (folder / "command").read_text()


def test_set_up_is_done_once(companion, hosts, checkout, capfd):
    start(companion, "farewell")
    cache = hosts.home / ".cache/airrace"
    (stamp,) = cache.glob("environments/*/complete")
    before = (stamp.parent / "pyvenv.cfg").stat().st_ino
    assert not list(cache.rglob("*.whl"))  # they are installed
    capfd.readouterr()
    again = SshCompanion(ADDRESS, checkout=checkout[0])  # no need of wheels any more
    start(again, "farewell")
    again.close()
    shown = capfd.readouterr().err
    assert "connecting" in shown and "install" not in shown and "bringing" not in shown

    # Other code, the same lock: the environment stays.
    changed = checkout[0] / "airrace" / "new.py"
    changed.write_text("NEW = 1\n")
    try:
        third = SshCompanion(ADDRESS, checkout=checkout[0])
        start(third, "farewell")
        third.close()
    finally:
        changed.unlink()
    shown = capfd.readouterr().err
    assert "bringing this airrace" in shown and LOCK not in shown
    assert (stamp.parent / "pyvenv.cfg").stat().st_ino == before
    assert len(list(cache.glob("packages/*/airrace/new.py"))) == 1


@pytest.mark.repeats
def test_interrupted_set_up_is_done_again(companion, hosts, checkout):
    start(companion, "farewell")
    for stamp in (hosts.home / ".cache/airrace").glob("*/*/complete"):
        stamp.unlink()
        for file in list(stamp.parent.rglob("*.py"))[:20]:
            file.write_text("broken (")
    again = SshCompanion(ADDRESS, checkout=checkout[0], wheels=checkout[1])
    autonomy, log = start(again, "farewell")
    assert log.end(autonomy) == 0
    again.close()


def test_arguments_arrive_as_they_are(companion, hosts):
    words = ["a b", "it's", '"', "$(touch /tmp/x)", "; touch x", "\\", "*", "~", "ä\t", "%s"]
    autonomy, log = start(companion, *words)
    assert log[0] == f"arguments {words}"


def test_farewell_is_told(companion):
    autonomy, log = start(companion, "farewell")
    assert log.end(autonomy) == 0
    autonomy.stop()
    assert autonomy.poll() == 0


def test_killed_autonomy_takes_its_workers_along(companion, tmp_path):
    autonomy, log = start(companion, "die", "worker")
    assert log.end(autonomy) == -9
    autonomy.collect(tmp_path)
    assert not alive(int((tmp_path / "worker").read_text()))


def test_stubborn_autonomy_is_killed(companion, tmp_path):
    autonomy, _ = start(companion, "stubborn", "worker")
    clock = time.monotonic()
    autonomy.stop(timeout=0.3)
    assert 0.3 < time.monotonic() - clock < 3.0
    assert autonomy.poll() == -9
    autonomy.collect(tmp_path)
    assert not alive(int((tmp_path / "worker").read_text()))


def test_one_race_at_a_time(companion, checkout):
    start(companion, "talk")
    second = SshCompanion(ADDRESS, checkout=checkout[0])
    with pytest.raises(UserError, match=r"Another race's autonomy is running on 10.0.0.2; .*kill"):
        second.start([], {}, print)
    second.close()


def test_port_in_use(companion, hosts):
    script = (
        "import socket, time; s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM);"
        "s.bind(('', 7667)); print(flush=True); time.sleep(60)"
    )
    with subprocess.Popen(
        ["ip", "netns", "exec", hosts.companion, sys.executable, "-c", script],
        stdout=subprocess.PIPE,
    ) as program:
        program.stdout.readline()
        words = ["--lcm_url", "udpm://239.255.76.67:7667?ttl=1"]
        with pytest.raises(UserError, match="UDP port 7667 is in use on 10.0.0.2 .*--lcm_url"):
            companion.start(words, {}, print)
        program.kill()
    start(companion, *words)


def test_closing_ends_what_runs(companion, hosts, tmp_path):
    autonomy, log = start(companion, "worker")
    (folder,) = runs(hosts)
    worker = int((folder / "output/worker").read_text())
    companion.close()
    assert not alive(worker)
    assert not runs(hosts)
