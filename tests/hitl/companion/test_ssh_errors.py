"""What a user reads when a companion cannot be reached or set up: one sentence each."""

import asyncio
import contextlib
import os
import shutil
import socket
import subprocess
import sys
import threading
import types
from pathlib import Path

import pytest

from airrace.common.errors import exit_code
from airrace.hitl.companion import set_up
from airrace.hitl.companion.address import Address
from airrace.hitl.companion.set_up import LOCK
from airrace.hitl.companion.ssh_companion import SshCompanion
from airrace.hitl.companion.ssh_errors import connect_error
from tests.hitl.companion.conftest import ADDRESS
from tests.hitl.companion.fake_checkout import make_checkout
from tests.hitl.companion.two_hosts import COMPANION, SSHD, WORKSTATION
from tests.worlds.cases import first


@pytest.fixture
def refusal(checkout, capfd):
    """Starts a companion's autonomy, which must fail; returns the sentence."""

    def start(address=ADDRESS, checkout=checkout[0], wheels=checkout[1], arguments=(), **options):
        companion = SshCompanion(address, checkout=checkout, wheels=wheels, **options)
        with contextlib.closing(companion):
            capfd.readouterr()
            assert exit_code(lambda: companion.start(arguments, {}, print)) == 2
        output, error = capfd.readouterr()
        sentence = error.splitlines()[-1]
        assert output == "" and "Traceback" not in error
        assert sentence.startswith("airrace: ") and sentence.endswith(".")
        return sentence

    return start


def test_unknown_host(hosts, refusal):
    sentence = refusal(Address("root", "no-such-host.invalid"))
    assert "no host named no-such-host.invalid" in sentence and "/etc/hosts" in sentence


@pytest.mark.slow
def test_host_that_is_not_there(hosts, refusal):
    sentence = refusal(Address("root", "10.0.0.77"))
    assert "10.0.0.77 cannot be reached" in sentence and "ping 10.0.0.77" in sentence


def test_port_without_a_server(hosts, refusal):
    sentence = refusal(Address("root", COMPANION, 2222))
    assert "Nothing listens on port 2222 of 10.0.0.2" in sentence
    assert "openssh-server" in sentence


def test_what_is_no_ssh_server(hosts, refusal):
    with socket.create_server((WORKSTATION, 0)) as server:

        def serve():
            connection, _ = server.accept()
            connection.sendall(b"HTTP/1.0 400 Bad Request\r\n\r\n")
            connection.close()

        thread = threading.Thread(target=serve)
        thread.start()
        sentence = refusal(Address("root", WORKSTATION, server.getsockname()[1]))
        thread.join()
    assert "is no ssh server" in sentence


def test_refused_key(hosts, refusal, tmp_path):
    subprocess.run(
        ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", tmp_path / "other key"], check=True
    )
    sentence = refusal(identity=tmp_path / "other key")
    assert "10.0.0.2 refuses your ssh key for the user root" in sentence
    assert f"ssh-copy-id -i '{tmp_path}/other key' root@10.0.0.2" in sentence
    shutil.copy(tmp_path / "other key.pub", hosts.folder / "authorized_keys")
    try:
        companion = SshCompanion(ADDRESS, identity=tmp_path / "other key")
        companion.connection()
        companion.close()
        assert "refuses your ssh key" in refusal()
    finally:
        shutil.copy(hosts.ssh / "id_ed25519.pub", hosts.folder / "authorized_keys")


def test_no_key_at_all(hosts, refusal, tmp_path, monkeypatch):
    (tmp_path / ".ssh").mkdir()
    shutil.copy(hosts.ssh / "known_hosts", tmp_path / ".ssh")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert "make a key with 'ssh-keygen'" in refusal()


def test_keys_that_cannot_be_used(hosts, refusal, tmp_path):
    (tmp_path / "key").write_text("no key")
    assert f"--identity {tmp_path}/key cannot be used" in refusal(identity=tmp_path / "key")
    subprocess.run(
        ["ssh-keygen", "-q", "-t", "ed25519", "-N", "secret", "-f", tmp_path / "locked"], check=True
    )
    assert "ssh-add" in refusal(identity=tmp_path / "locked")


def test_unknown_host_key(hosts, refusal):
    (hosts.ssh / "known_hosts").write_text("")
    sentence = refusal()
    assert "host key of 10.0.0.2 is not known" in sentence and "ssh root@10.0.0.2" in sentence
    (hosts.ssh / "known_hosts").unlink()
    assert "is not known" in refusal()


@pytest.mark.parametrize("kind", first(["ed25519", "ecdsa", "rsa"]))
def test_changed_host_key(hosts, refusal, tmp_path, kind):
    subprocess.run(["ssh-keygen", "-q", "-t", kind, "-N", "", "-f", tmp_path / "old"], check=True)
    hosts.trust(tmp_path / "old.pub")
    sentence = refusal()
    assert "host key of 10.0.0.2 has CHANGED" in sentence
    assert "ssh-keygen -R 10.0.0.2" in sentence
    subprocess.run(
        ["ssh-keygen", "-q", "-H", "-f", hosts.ssh / "known_hosts"], check=True, capture_output=True
    )
    assert COMPANION not in (hosts.ssh / "known_hosts").read_text()
    assert refusal() == sentence


def test_no_python_there(hosts, refusal, tmp_path):
    hosts.path.rename(tmp_path / "away")
    try:
        sentence = refusal()
        assert "no Python 3.12, 3.13 or 3.14 with venv on 10.0.0.2" in sentence
        assert "install uv there" in sentence and "uv python install 3.12" in sentence
        # With uv there, which knows none either.
        hosts.path.mkdir()
        (hosts.path / "uv").write_text("#!/bin/sh\nexit 2\n")
        (hosts.path / "uv").chmod(0o755)
        sentence = refusal()
        assert "install uv there" not in sentence and "uv python install 3.12" in sentence
        # And one that knows one.
        (hosts.path / "uv").write_text(f"#!/bin/sh\necho {Path(sys.executable).resolve()}\n")
        companion = SshCompanion(ADDRESS)
        found = set_up.inspect_board(companion.connection(), ADDRESS, "environment", "package")
        companion.close()
        assert Path(found["python"]).exists()
        assert found["cache"] == f"{hosts.home}/.cache/airrace"
    finally:
        shutil.rmtree(hosts.path, ignore_errors=True)
        (tmp_path / "away").rename(hosts.path)


@pytest.fixture
def small_disk(hosts):
    """A disk of 1 MB under airrace's cache on the companion."""
    cache = hosts.home / ".cache"
    cache.mkdir(exist_ok=True)
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", cache], check=True)
    hosts.restart_server()  # so that it sees the disk
    yield cache
    subprocess.run(["umount", "--lazy", cache], check=True)
    hosts.restart_server()


@pytest.mark.slow
def test_full_disk(small_disk, refusal, checkout, monkeypatch):
    # Seen before anything is done,
    sentence = refusal()
    assert "The disk of 10.0.0.2 is full" in sentence and "make room" in sentence
    assert not list(small_disk.glob("airrace/environments/*/bin"))
    # while the environment is made,
    monkeypatch.setattr(set_up, "_ROOM", 0)
    sentence = refusal()
    assert "The disk of 10.0.0.2 is full" in sentence
    # and while files are brought.
    (small_disk / "rest").write_bytes(bytes(os.statvfs(small_disk).f_bavail * 4096))
    shutil.rmtree(small_disk / "airrace")
    with contextlib.suppress(OSError):
        (small_disk / "more").write_bytes(bytes(2_000_000))
    sentence = refusal()
    assert "The disk of 10.0.0.2 is full" in sentence


def test_folder_that_may_not_be_written(hosts, refusal):
    cache = hosts.home / ".cache"
    if cache.exists():
        cache.rename(hosts.home / "away")
    cache.write_text("a file")
    sentence = refusal()
    cache.unlink()
    if (hosts.home / "away").exists():
        (hosts.home / "away").rename(cache)
    assert "on 10.0.0.2 cannot be used" in sentence


@pytest.mark.slow
def test_wheels_that_are_not_the_locked_ones(hosts, refusal, tmp_path):
    checkout, wheels = make_checkout(tmp_path)
    lock = checkout / LOCK
    lock.write_text(f"{lock.read_text()}numpy==1.0 --hash=sha256:{'0' * 64}\n")
    (tmp_path / "empty").mkdir()
    assert f"holds no wheel of {LOCK}" in refusal(checkout=checkout, wheels=tmp_path / "empty")
    sentence = refusal(checkout=checkout, wheels=wheels)
    assert "No matching distribution found for numpy==1.0" in sentence and "--wheels" in sentence


@pytest.mark.repeats
def test_drake_that_cannot_be_imported(hosts, refusal, tmp_path):
    checkout, wheels = make_checkout(tmp_path, drake="raise ImportError('libglib-2.0.so.0: no')")
    sentence = refusal(checkout=checkout, wheels=wheels)
    assert "Drake cannot be imported on 10.0.0.2" in sentence and "libglib2.0-0" in sentence


def test_shell_that_runs_nothing(hosts, monkeypatch, refusal):
    monkeypatch.setattr(
        "airrace.hitl.companion.ssh.SshConnection.run",
        lambda *_: (1, b"", "This account is currently not available.\n"),
    )
    assert "This account is currently not available" in refusal()


@pytest.mark.skipif(not SSHD, reason="there is no sshd to tell apart")
def test_names_of_ssh_config(hosts, tmp_path):
    (hosts.ssh / "config").write_text(f"Host board\n  HostName {COMPANION}\n  User nobody\n")
    hosts.trust(hosts.folder / "host_key.pub", COMPANION)
    try:
        companion = SshCompanion(Address("root", "board"))
        assert companion.connection().run(["id", "-u"])[:2] == (0, b"0\n")
        companion.close()
    finally:
        (hosts.ssh / "config").unlink()


def test_events_of_other_programs_are_noise():
    for line in ("Welcome!", "airrace-", "airrace: a step"):
        assert set_up.event_of(line) == ("", line)
    assert set_up.event_of("airrace-step: a: b") == ("step", "a: b")


def test_errors_without_words():
    address = Address("root", "board")
    options = types.SimpleNamespace(port=2222, known_hosts=b"", host="board", host_key_alias=None)

    def sentence(error):
        return str(asyncio.run(connect_error(error, address, None, options)))

    several = OSError("Multiple exceptions: [Errno 111] Connect call failed, [Errno 111] ...")
    assert "Nothing listens on port 2222 of board" in sentence(several)
    assert "board cannot be reached (no answer)" in sentence(TimeoutError())
