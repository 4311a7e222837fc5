"""A race whose autonomy is started over ssh on an emulated 64-bit Arm computer.

tools/arm64_test.bash makes its root file system, with an environment in it, and runs this.
"""

import os
from pathlib import Path

import pytest

from airrace.common.files import digest
from airrace.hitl.companion.set_up import LOCK, source_digest
from airrace.hitl.companion.ssh import SshConnection
from tests.hitl.companion.conftest import ADDRESS, at_workstation
from tests.hitl.companion.fake_checkout import ROOT
from tests.hitl.companion.test_lost_connection import programs
from tests.hitl.companion.test_race_over_ssh import race
from tests.hitl.companion.two_hosts import TwoHosts

BOARD = os.environ.get("AIRRACE_ARM64_ROOT", "")

pytestmark = pytest.mark.skipif(not BOARD, reason="needs an Arm root: run tools/arm64_test.bash")


@pytest.fixture
def board(namespaces, tmp_path, monkeypatch):
    with (
        TwoHosts(tmp_path / "hosts", "sshd", root=Path(BOARD)) as hosts,
        at_workstation(hosts, monkeypatch),
    ):
        yield hosts


def test_start_over_ssh(board, hexagon, tmp_path):  # noqa: F811
    """The first 5 s, in which the drone takes off and sees the first gates, are as in SITL."""
    connection = SshConnection(ADDRESS)
    assert connection.run(["uname", "-m"])[1] == b"aarch64\n"
    connection.close()
    options = ["--track", hexagon, "--scenario_text", "{referee: {time_limit: 5.0}}"]
    done, sitl = race(tmp_path / "sitl", *options)
    assert sitl is not None, done.said
    hitl = ["-s", "HITL", "--lockstep", "--companion", str(ADDRESS)]
    done, result = race(tmp_path / "hitl", *options, *hitl)
    assert result is not None, done.said
    assert "making an environment" not in done.said
    assert result["dnf_reason"] == sitl["dnf_reason"]
    assert result["exploration"] == sitl["exploration"] and sitl["exploration"]["events"]
    (log,) = (tmp_path / "hitl").rglob("autonomy.log")
    assert "airrace: autonomy ready" in log.read_text()
    cache = board.home / ".cache/airrace"
    assert (cache / "environments" / digest(ROOT / LOCK) / "complete").exists()
    assert (cache / "packages" / source_digest(ROOT) / "complete").exists()
    assert not list((cache / "runs").iterdir())
    assert not programs(board, "airrace")
