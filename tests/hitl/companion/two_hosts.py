"""Two hosts on one cable, made of network namespaces, with an ssh server on one of them.

The workstation is 10.0.0.1 and the companion 10.0.0.2. Only root can make them.
"""

import contextlib
import itertools
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

from airrace.common.patience import patient
from tests.hitl.companion.bad_cable import in_namespace

WORKSTATION, COMPANION = "10.0.0.1", "10.0.0.2"
_numbers = itertools.count()
SSHD = shutil.which("sshd", path="/usr/sbin:/usr/local/sbin:" + os.environ.get("PATH", ""))


def reason_to_skip() -> str | None:
    """Returns why this machine cannot have two hosts, or None."""
    if sys.platform != "linux" or os.geteuid() != 0:
        return "network namespaces are for root on Linux"
    for program in ("ip", "unshare", "mount", "ssh-keygen"):
        if not shutil.which(program):
            return f"there is no {program}"
    name = f"airrace-try-{os.getpid()}"
    if subprocess.run(["ip", "netns", "add", name], capture_output=True).returncode:
        return "network namespaces cannot be made here"
    subprocess.run(["ip", "netns", "del", name])
    return None


class TwoHosts(contextlib.ExitStack):
    """The two hosts, while its ``with`` block lasts."""

    def __init__(
        self,
        folder: Path,
        server: str | None = None,
        home: Path | None = None,
        root: Path | None = None,
    ):
        """Constructs them.

        Args:
            folder: an empty one.
            server: "sshd" or "asyncssh"; None: the first there is.
            home: of the user on the companion; None: an empty one.
            root: the root file system that users of the companion are in, by sshd, if it is
                another than that of this computer.
        """
        super().__init__()
        self.folder = folder
        self.server = server or ("sshd" if SSHD else "asyncssh")
        number = f"air{os.getpid()}-{next(_numbers)}"
        self.workstation, self.companion = f"{number}w", f"{number}c"
        self.root = root
        self.home = home or (root / "root" if root else folder / "companion-home")
        self.path = folder / "companion-bin"  # its PATH's first entry
        self.ssh = folder / "workstation-home" / ".ssh"

    def __enter__(self):
        with contextlib.ExitStack() as undo:
            for folder in (self.home, self.path, self.ssh):
                folder.mkdir(parents=True, exist_ok=True)
            self._keygen(self.ssh / "id_ed25519")
            self._keygen(self.folder / "host_key")
            self.trust(self.folder / "host_key.pub")
            shutil.copy(self.ssh / "id_ed25519.pub", self.folder / "authorized_keys")
            undo.callback(self._delete)
            for name in (self.workstation, self.companion):
                _ip("netns", "add", name)
                _ip("-n", name, "link", "set", "lo", "up")
                with in_namespace(name):  # as docs/board.md has it
                    Path("/proc/sys/net/ipv4/ipfrag_time").write_text("1")
            self._lay_cable()
            self.process = self._serve()
            undo.callback(self.stop_server)
            self.push(undo.pop_all())
        return self

    def _lay_cable(self):
        _ip(
            "link",
            "add",
            "veth0",
            "netns",
            self.workstation,
            "type",
            "veth",
            "peer",
            "name",
            "veth0",
            "netns",
            self.companion,
        )
        self._connect()

    def _connect(self):
        for name, address in ((self.workstation, WORKSTATION), (self.companion, COMPANION)):
            _ip("-n", name, "address", "add", f"{address}/24", "dev", "veth0")
            _ip("-n", name, "link", "set", "veth0", "up")
            _ip("-n", name, "route", "add", "224.0.0.0/4", "dev", "veth0")

    def _delete(self):
        for name in (self.workstation, self.companion):
            subprocess.run(["ip", "netns", "del", name], capture_output=True)

    def _keygen(self, path, kind="ed25519"):
        subprocess.run(["ssh-keygen", "-q", "-t", kind, "-N", "", "-f", path], check=True)

    def trust(self, public_key: Path, host: str = COMPANION) -> None:
        """Makes known_hosts of the workstation hold this key of a host, and nothing else."""
        kind, key = public_key.read_text().split()[:2]
        (self.ssh / "known_hosts").write_text(f"{host} {kind} {key}\n")

    def _serve(self):
        start = {"sshd": self._sshd, "asyncssh": self._asyncssh}[self.server]()
        with (self.folder / "server.log").open("ab") as log:
            process = subprocess.Popen(
                ["ip", "netns", "exec", self.companion, *start],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=log,
                start_new_session=True,
            )
        with self.on_workstation():
            deadline = time.monotonic() + patient(10.0)
            while True:
                try:
                    socket.create_connection((COMPANION, 22), 1.0).close()
                    return process
                except OSError:
                    assert time.monotonic() < deadline, (self.folder / "server.log").read_text()
                    time.sleep(0.02)

    def _sshd(self):
        config = self.folder / "sshd_config"
        home, more = self.home, ""
        if self.root:
            home = Path("/") / self.home.relative_to(self.root)
            # Of an emulated processor, which sshd would not hand on.
            more = f"QEMU_CPU={os.environ['QEMU_CPU']}\nChrootDirectory {self.root}"
        config.write_text(f"""
HostKey {self.folder}/host_key
AuthorizedKeysFile {self.folder}/authorized_keys
StrictModes no
UsePAM no
PasswordAuthentication no
PidFile none
Subsystem sftp internal-sftp
SetEnv HOME={home} PATH={self.path}:/usr/bin:/bin {more}
""")
        # sshd wants a folder below /run: it gets a /run of its own.
        script = f'mount -t tmpfs tmpfs /run && mkdir /run/sshd && exec {SSHD} -D -e -f "$0"'
        return ["unshare", "--mount", "sh", "-c", script, str(config)]

    def _asyncssh(self):
        server = Path(__file__).with_name("asyncssh_server.py")
        return [sys.executable, str(server), str(self.folder), str(self.home), str(self.path)]

    def stop_server(self) -> None:
        """Ends the ssh server and all that it has started."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        listed = subprocess.run(
            ["ip", "netns", "pids", self.companion], capture_output=True, text=True
        ).stdout.split()
        for pid in map(int, listed):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)

    def restart_server(self) -> None:
        """Ends it and starts it again."""
        self.stop_server()
        self.process = self._serve()

    def on_workstation(self):
        """Has this thread, and those that it starts, on the workstation."""
        return in_namespace(self.workstation)

    @contextlib.contextmanager
    def bad_cable(self, delay: float, jitter: float, loss: float):
        """Has a bad cable: by netem, or where the kernel has none, by bad_cable.py.

        Args: delay, jitter: of every packet (ms). loss: of packets (%).
        """
        netem = ["netem", "delay", f"{delay}ms", f"{jitter}ms", "loss", f"{loss}%"]
        names = (self.workstation, self.companion)
        tc = [
            subprocess.run(
                ["tc", "-n", name, "qdisc", "add", "dev", "veth0", "root", *netem],
                capture_output=True,
            ).returncode
            for name in names
        ]
        if not any(tc):
            try:
                yield
            finally:
                for name in names:
                    subprocess.run(["tc", "-n", name, "qdisc", "del", "dev", "veth0", "root"])
            return
        _ip("-n", self.workstation, "link", "del", "veth0")
        for name in names:
            _ip("-n", name, "tuntap", "add", "dev", "veth0", "mode", "tap")
        program = Path(__file__).with_name("bad_cable.py")
        with subprocess.Popen(
            [sys.executable, str(program), *names, "veth0", *map(str, (delay, jitter, loss))],
            stdout=subprocess.PIPE,
            text=True,
        ) as relay:
            try:
                assert relay.stdout.readline() == "here\n"
                self._connect()
                yield
            finally:
                relay.kill()
                for name in names:
                    _ip("-n", name, "link", "del", "veth0")
                self._lay_cable()

    def cable(self, plugged: bool) -> None:
        """Plugs the cable in, or pulls it."""
        _ip("-n", self.workstation, "link", "set", "veth0", "up" if plugged else "down")
        if plugged:
            _ip("-n", self.workstation, "route", "replace", "224.0.0.0/4", "dev", "veth0")


def _ip(*arguments):
    subprocess.run(["ip", *arguments], check=True, capture_output=True, text=True)
