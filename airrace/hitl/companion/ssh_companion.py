"""The autonomy on another computer, which is reached by ssh."""

import contextlib
import queue
import secrets
import tempfile
import time
import urllib.parse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from airrace.common.errors import UserError
from airrace.hitl.companion import OUTPUT
from airrace.hitl.companion.address import Address
from airrace.hitl.companion.deployment import Deployment
from airrace.hitl.companion.set_up_display import SetUpDisplay
from airrace.hitl.companion.ssh import ConnectionLost, SshConnection
from airrace.hitl.companion.wheel import checkout_path

_START_TIMEOUT = 20.0  # s
_PATIENCE = 10.0  # s from one attempt to connect to the next
_LCM_PORT = 7667


class SshCompanion:
    """A computer with an ssh server; see airrace.hitl.companion.Companion.

    Attributes:
        address: where it is.
    """

    def __init__(
        self,
        address: Address,
        *,
        identity: Path | None = None,
        wheels: Path | None = None,
        checkout: Path | None = None,
    ):
        """Constructs it; the first start() connects and sets the companion up.

        Args:
            address: of the companion.
            identity: the file of a private key; None: those that ssh would try.
            wheels: a folder of wheels to bring and install from, for a companion
                without the internet; None: it has the internet.
            checkout: whose airrace to bring; None: the one that runs.
        """
        self.address = address
        self._identity = identity
        self._wheels = wheels
        self._checkout = checkout
        self._connection = self._deployment = None
        self._failure = None, 0.0  # the last connection that could not be made, and when (s)
        self._running = []

    def start(
        self, arguments: Sequence[str], files: Mapping[str, bytes], log: Callable[[str], None]
    ) -> "RemoteAutonomy":
        """See Companion.start()."""
        try:
            if self._deployment is None:
                self._set_up()
            autonomy = RemoteAutonomy(self, self._deployment, arguments, files, log)
        except ConnectionLost as e:
            raise UserError(
                f"The ssh connection to {self.address.host} was lost ({e}); check "
                "the cable, and start again: what is done there is kept."
            ) from None
        self._running.append(autonomy)
        return autonomy

    def _set_up(self):
        checkout = self._checkout or checkout_path()
        with SetUpDisplay(self.address.host) as display:
            display.step("connecting")
            self._deployment = Deployment(
                self.connection(), self.address.host, checkout, self._wheels, display
            )

    def connection(self) -> SshConnection:
        """Returns the connection, made again if it was lost.

        Raises:
            UserError: if it cannot be made.
        """
        if self._connection is None or self._connection.lost:
            error, when = self._failure
            if error is not None and time.monotonic() - when < _PATIENCE:
                raise error  # it takes its time to fail
            if self._connection is not None:
                self._connection.close()
            try:
                self._connection = SshConnection(self.address, self._identity)
            except UserError as e:
                self._failure = e, time.monotonic()
                raise
        return self._connection

    def close(self) -> None:
        """See Companion.close()."""
        for autonomy in self._running:
            autonomy.stop()
            autonomy.remove()
        self._running.clear()
        if self._connection is not None:
            self._connection.close()


class RemoteAutonomy:
    """A process of another computer; see airrace.hitl.companion.Autonomy.

    When the ssh connection is lost, it runs on, and so does the race as long as
    its messages come: poll() knows no better than that it runs. stop() and
    collect() connect again.
    """

    def __init__(self, companion, deployment, arguments, files, log):
        """Starts it.

        Args:
            companion: the SshCompanion.
            deployment: what is on it.
            arguments, files, log: see Companion.start().

        Raises:
            UserError: if it cannot be started.
            ConnectionLost: if the connection goes.
        """
        self._companion, self._deployment, self._log = companion, deployment, log
        self._code = None
        self._lost = self._keep = False
        self._events = queue.SimpleQueue()
        name = f"{time.strftime('%Y%m%dT%H%M%SZ', time.gmtime())}-{secrets.token_hex(4)}"
        self._folder = f"{deployment.cache}/runs/{name}"
        connection = companion.connection()
        with tempfile.TemporaryDirectory(prefix="airrace-") as scratch:
            there = {}
            for i, (path, contents) in enumerate(files.items()):
                there[f"{self._folder}/{path}"] = here = Path(scratch) / str(i)
                here.write_bytes(contents)
            connection.put(there)
        job = {
            "do": "run",
            "folder": self._folder,
            "udp_port": _udp_port(arguments),
            "arguments": ["-u", "-m", "airrace.diagrams.hitl", *arguments],
        }
        self._send = deployment.start(connection, job, self._events.put)
        try:
            self._await_start(connection)
        except BaseException:
            with contextlib.suppress(ConnectionLost):
                self._send("0\n")
            self.remove()
            raise

    def _await_start(self, connection):
        noise = []
        while (event := self._next_event())["event"] != "running":
            if event["event"] != "noise":
                raise self._deployment.failure(connection, event, noise)
            noise.append(event["line"])

    def _next_event(self) -> dict:
        try:
            return self._events.get(timeout=_START_TIMEOUT)
        except queue.Empty:
            return {"event": f"it says nothing for {_START_TIMEOUT:.0f} s"}

    def poll(self) -> int | None:
        """See Autonomy.poll()."""
        while self._code is None and not self._lost:
            try:
                event = self._events.get_nowait()
            except queue.Empty:
                break
            match event["event"]:
                case "log" | "noise":
                    self._log(event["line"])
                case "exit":
                    self._code = event["code"]
                case "end":
                    self._lost = True
                    self._log(
                        "airrace: the ssh connection was lost; the race goes on as long "
                        "as its messages come"
                    )
        return self._code

    def stop(self, timeout: float = 5.0) -> None:
        """See Autonomy.stop()."""
        if self.poll() is None and not self._lost:
            with contextlib.suppress(ConnectionLost):  # then poll() learns it too
                self._send(f"{timeout}\n")
        end = time.monotonic() + timeout + 5.0
        while self.poll() is None and not self._lost and time.monotonic() < end:
            time.sleep(0.02)
        if self._code is None:
            self._stop_again()

    def _stop_again(self):
        """Ends it through another connection, if there can be one."""
        try:
            events = queue.SimpleQueue()
            self._deployment.start(
                self._companion.connection(), {"do": "stop", "folder": self._folder}, events.put
            )
            events.get(timeout=_START_TIMEOUT)
        except (UserError, ConnectionLost, queue.Empty):
            pass  # it ends by itself: the simulation's heartbeats are missing
        self._code = -1

    def collect(self, folder: Path) -> None:
        """See Autonomy.collect()."""
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._companion.connection().get(f"{self._folder}/{OUTPUT}", folder)
        except (UserError, ConnectionLost, OSError) as e:
            self._keep = True
            raise UserError(
                f"What the autonomy wrote cannot be fetched ({str(e).rstrip('.')}); it "
                f"is in {self._folder} on the companion."
            ) from None

    def remove(self) -> None:
        """Removes its working directory, unless what is in it could not be fetched."""
        if self._keep:
            return
        try:
            self._companion.connection().remove(self._folder)
        except (UserError, ConnectionLost):
            pass  # later set-ups remove it


def _udp_port(arguments: Sequence[str]) -> int | None:
    """Returns the port of the LCM URL that a command line names; None: no UDP."""
    urls = [value for option, value in zip(arguments, arguments[1:]) if option == "--lcm_url"]
    try:
        url = urllib.parse.urlsplit(urls[-1] if urls else "udpm://")
        return (url.port or _LCM_PORT) if url.scheme == "udpm" else None
    except ValueError:
        return None  # the autonomy says what is wrong with it
