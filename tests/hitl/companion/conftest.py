"""Two hosts, and a companion on one of them that is set up once."""

import contextlib
import sys
from pathlib import Path

import pytest

from airrace.hitl.companion.address import Address
from airrace.hitl.companion.ssh_companion import SshCompanion
from tests.hitl.companion.fake_checkout import make_checkout
from tests.hitl.companion.two_hosts import COMPANION, TwoHosts, reason_to_skip

ADDRESS = Address("root", COMPANION)


@pytest.fixture(scope="session")
def namespaces():
    """Skips a test where network namespaces cannot be had."""
    if reason := reason_to_skip():
        pytest.skip(reason)


@pytest.fixture(scope="module")
def shared_hosts(namespaces, tmp_path_factory):
    with TwoHosts(tmp_path_factory.mktemp("hosts")) as hosts:
        (hosts.path / "python3.12").symlink_to(Path(sys.executable).resolve())
        yield hosts


@pytest.fixture
def hosts(shared_hosts, monkeypatch):
    """The two hosts of a module's tests; this thread is on the workstation."""
    with at_workstation(shared_hosts, monkeypatch):
        yield shared_hosts


@contextlib.contextmanager
def at_workstation(hosts, monkeypatch):
    """Has this thread on the workstation, with the home directory of its user."""
    monkeypatch.setenv("HOME", str(hosts.ssh.parent))
    for name in ("SSH_AUTH_SOCK", "PYTHONPATH"):
        monkeypatch.delenv(name, raising=False)
    hosts.trust(hosts.folder / "host_key.pub")
    with hosts.on_workstation():
        yield


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """A checkout with a tiny autonomy, and the wheels of its lock."""
    return make_checkout(tmp_path_factory.mktemp("checkout"))


@pytest.fixture
def companion(hosts, checkout):
    """A companion with the tiny autonomy; set up by the first test that starts something."""
    companion = SshCompanion(ADDRESS, checkout=checkout[0], wheels=checkout[1])
    yield companion
    companion.close()
