"""The autonomy on another computer, which is reached by ssh."""

import contextlib
import queue
import secrets
import shlex
import tarfile
import time
import urllib.parse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from airrace.common.errors import UserError
from airrace.common.patience import VARIABLE, patient
from airrace.hitl.companion import OUTPUT, Autonomy, Companion
from airrace.hitl.companion.address import Address
from airrace.hitl.companion.set_up import (
    Board,
    SetUpDisplay,
    board_command,
    checkout_path,
    event_of,
    failure,
    set_up,
)
from airrace.hitl.companion.ssh import ConnectionLost, SshConnection

_START_TIMEOUT = 20.0  # s
_RETRY_PERIOD = 10.0  # s from one attempt to connect to the next
_LCM_PORT = 7667
_LOST = "airrace: the ssh connection was lost; the race goes on as long as its messages come"


class SshCompanion(Companion):
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
            identity: the file of a private key; None: those that ssh would try.
            wheels: a folder of wheels to bring and install from, for a companion
                without the internet; None: it has the internet.
            checkout: whose airrace to bring; None: the one that runs.
        """
        super().__init__()
        self.address = address
        self._identity, self._wheels, self._checkout = identity, wheels, checkout
        self._connection: SshConnection | None = None
        self._board: Board | None = None
        # The last connection that could not be made, and when (s).
        self._failure: tuple[UserError | None, float] = None, 0.0

    def start(
        self, arguments: Sequence[str], files: Mapping[str, bytes], log: Callable[[str], None]
    ) -> "RemoteAutonomy":
        try:
            if self._board is None:
                checkout = self._checkout or checkout_path()
                with SetUpDisplay(self.address.host) as display:
                    display.step("connecting")
                    self._board = set_up(
                        self.connection(), self.address, checkout, self._wheels, display
                    )
            autonomy = RemoteAutonomy(self, self._board, arguments, files, log)
        except ConnectionLost as e:
            raise UserError(
                f"The ssh connection to {self.address.host} was lost ({e}); check "
                "the cable, and start again: what is done there is kept."
            ) from None
        self._running.append(autonomy)
        return autonomy

    def connection(self) -> SshConnection:
        """Returns the connection, made again if it was lost.

        Raises UserError if it cannot be made.
        """
        if self._connection is None or self._connection.lost:
            error, when = self._failure
            if error is not None and time.monotonic() - when < _RETRY_PERIOD:
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
        super().close()
        if self._connection is not None:
            self._connection.close()


class RemoteAutonomy(Autonomy):
    """A process of another computer; see airrace.hitl.companion.Autonomy.

    When the ssh connection is lost, it runs on, and so does the race as long as
    its messages come: poll() knows no better than that it runs. stop() and
    collect() connect again.
    """

    def __init__(
        self,
        companion: SshCompanion,
        board: Board,
        arguments: Sequence[str],
        files: Mapping[str, bytes],
        log: Callable[[str], object],
    ):
        """Starts it; see Companion.start().

        Raises:
            UserError: if it cannot be started.
            ConnectionLost: if the connection goes.
        """
        self._companion, self._log = companion, log
        self._code: int | None = None
        self._lost = self._keep = False
        name = f"{time.strftime('%Y%m%dT%H%M%SZ', time.gmtime())}-{secrets.token_hex(4)}"
        self._folder = f"{board.cache}/runs/{name}"
        variables = [
            "PYTHONUNBUFFERED=1",
            "PYTHONDONTWRITEBYTECODE=1",
            f"PYTHONPATH={board.package}",
            f"{VARIABLE}={patient(1.0)}",
        ]
        program = board.python, "-P", "-m", "airrace.hitl", "autonomy", *arguments
        command = shlex.join(["exec", "env", *variables, *program])
        connection = companion.connection()
        connection.put(self._folder, {**files, "command": command.encode()})
        self._lines = connection.start(
            *board_command("run", self._folder, _udp_port(arguments), board.python)
        )
        try:
            self._await_start()
        except BaseException:
            self.stop(0.0)
            self.remove()
            raise

    def _await_start(self):
        events = []
        while not events or events[-1][0] != "running":
            try:
                line = self._lines.get(timeout=patient(_START_TIMEOUT))
            except queue.Empty:
                raise ConnectionLost(f"no answer for {patient(_START_TIMEOUT):.0f} s") from None
            if not isinstance(line, str):
                self._code = -1
                raise failure(events, line, self._companion.address)
            events.append(event_of(line))

    def poll(self) -> int | None:
        while self._code is None and not self._lost:
            try:
                line = self._lines.get_nowait()
            except queue.Empty:
                break
            if isinstance(line, str):
                self._log(line)
            elif line is None:
                self._lost = True
                self._log(_LOST)
            else:
                self._code = 128 - line if line > 128 else line  # a shell's way to name signals
        return self._code

    def stop(self, timeout: float = 5.0) -> None:
        if self.poll() is not None:
            return
        with contextlib.suppress(UserError, ConnectionLost):
            # Else it ends by itself: the simulation's heartbeats are missing.
            self._companion.connection().run(*board_command("stop", self._folder, patient(timeout)))
        end = time.monotonic() + patient(5.0)
        while self.poll() is None and not self._lost and time.monotonic() < end:
            time.sleep(0.02)
        if self._code is None:
            self._code = -1

    def collect(self, folder: Path) -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._companion.connection().get(f"{self._folder}/{OUTPUT}", folder)
        except (UserError, ConnectionLost, OSError, tarfile.TarError) as e:
            self._keep = True
            raise UserError(
                f"What the autonomy wrote cannot be fetched ({str(e).rstrip('.')}); it "
                f"is in {self._folder} on the companion."
            ) from None

    def remove(self) -> None:
        if not self._keep:
            with contextlib.suppress(UserError, ConnectionLost):  # a later set-up removes it
                self._companion.connection().run(["rm", "-rf", self._folder])


def _udp_port(arguments: Sequence[str]) -> int:
    """Returns the port of the LCM URL that a command line names; 0: no UDP."""
    urls = [value for option, value in zip(arguments, arguments[1:]) if option == "--lcm_url"]
    try:
        url = urllib.parse.urlsplit(urls[-1] if urls else "udpm://")
        return (url.port or _LCM_PORT) if url.scheme == "udpm" else 0
    except ValueError:
        return 0  # the autonomy says what is wrong with it
