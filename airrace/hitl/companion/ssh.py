"""An ssh connection for code that is not asynchronous: commands, files, processes.

Keys only, host keys checked against known_hosts, ~/.ssh/config and the ssh agent
heeded, all by asyncssh. Its event loop runs in a thread of its own.
"""

import asyncio
import contextlib
import io
import queue
import shlex
import tarfile
import threading
from collections.abc import Mapping
from pathlib import Path

import asyncssh

from airrace.common.errors import words
from airrace.common.patience import patient
from airrace.hitl.companion.address import Address
from airrace.hitl.companion.ssh_errors import connect_error, file_error

_CONNECT_TIMEOUT = 10  # s
_LOGIN_TIMEOUT = 20  # s
_KEEPALIVE = 5  # s; after three of them without an answer the connection is lost


class ConnectionLost(Exception):
    """The ssh connection has gone; the message is a clause that says why."""


class SshConnection:
    """A connection to a companion computer."""

    def __init__(self, address: Address, identity: Path | None = None):
        """Connects.

        Args: identity: the file of a private key; None: those that ssh would try.

        Raises UserError if that fails; it names what is wrong and the remedy.
        """
        self._address = address
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self._followed = []
        try:
            self._connection = self._wait(self._connect(identity))
        except BaseException:
            self._end_loop()
            raise

    @property
    def lost(self) -> bool:
        """Whether the connection has ended."""
        return self._loop.is_closed() or self._connection.is_closed()

    def close(self) -> None:
        """Closes the connection; what runs there learns it by the end of its input."""
        if self._loop.is_closed():
            return
        with contextlib.suppress(Exception):
            self._wait(self._disconnect())
        self._end_loop()

    def _end_loop(self):
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _disconnect(self):
        self._connection.close()
        await asyncio.wait_for(self._connection.wait_closed(), 2.0)

    def _wait(self, coroutine):
        """Waits for a coroutine in the loop's thread; Ctrl-C cancels it."""
        future = asyncio.run_coroutine_threadsafe(coroutine, self._loop)
        try:
            return future.result()
        except (asyncssh.ConnectionLost, asyncssh.ChannelOpenError, ConnectionError) as e:
            raise ConnectionLost(words(e)) from None
        except BaseException:
            future.cancel()
            raise

    async def _connect(self, identity):
        address = self._address
        more = {"port": address.port} if address.port else {}
        if identity is not None:
            more |= {"client_keys": [str(identity)], "agent_path": None}
        options = None
        try:
            options = await asyncio.to_thread(
                asyncssh.SSHClientConnectionOptions,
                host=address.host,
                username=address.user,
                preferred_auth=["publickey"],
                password_auth=False,
                kbdint_auth=False,
                connect_timeout=patient(_CONNECT_TIMEOUT),
                login_timeout=patient(_LOGIN_TIMEOUT),
                keepalive_interval=patient(_KEEPALIVE),
                keepalive_count_max=3,
                **more,
            )
            return await asyncssh.connect(address.host, options=options)
        except (OSError, asyncssh.Error, ValueError) as e:
            raise await connect_error(e, address, identity, options) from None

    def run(self, arguments: list[str], data: bytes = b"") -> tuple[int, bytes, str]:
        """Runs a command to its end, each argument as it is, with data as its standard input.

        Returns exit code (-1: none), standard output, standard error.

        Raises ConnectionLost if the connection goes.
        """
        return self._wait(self._run(arguments, data))

    async def _run(self, arguments, data):
        done = await self._connection.run(shlex.join(arguments), input=data, encoding=None)
        if done.returncode is None and self._connection.is_closed():
            raise asyncssh.ConnectionLost("it ended in a command")
        code = -1 if done.returncode is None else done.returncode
        return code, done.stdout, done.stderr.decode(errors="replace")

    def start(self, arguments: list[str], data: bytes) -> queue.SimpleQueue:
        """Starts a command whose standard input, which begins with data, stays open.

        Returns:
            a queue of the lines that it writes to standard output or error, and at last
            of its exit code (int), or None if the connection was lost before.
        """
        lines = queue.SimpleQueue()
        coroutine = self._follow(shlex.join(arguments), data.decode(), lines)
        # Kept, since the loop itself does not keep its tasks alive.
        self._followed.append(asyncio.run_coroutine_threadsafe(coroutine, self._loop))
        return lines

    async def _follow(self, command, text, lines):
        code = None
        with contextlib.suppress(asyncssh.Error, OSError):
            process = await self._connection.create_process(
                command, stderr=asyncssh.STDOUT, errors="replace"
            )
            process.stdin.write(text)
            async for line in process.stdout:
                if line:  # there is none at the very end
                    lines.put(line.rstrip("\r\n"))
            await process.wait_closed()
            code = process.returncode
        lines.put(code)

    def put(self, folder: str, files: Mapping[str, bytes]) -> None:
        """Brings files, by their paths below a folder there, one after the other.

        Raises:
            UserError: if they cannot be written there.
            ConnectionLost: if the connection goes.
        """
        stream = io.BytesIO()
        with tarfile.open(fileobj=stream, mode="w") as archive:
            for path, data in files.items():
                info = tarfile.TarInfo(path)
                info.size, info.mode = len(data), 0o600  # one may be a key
                archive.addfile(info, io.BytesIO(data))
        script = 'mkdir -p "$0" && tar -x -m -o -f - -C "$0"'
        code, _, error = self.run(["sh", "-c", script, folder], stream.getvalue())
        if code:
            raise file_error(error, folder, self._address)

    def get(self, there: str, here: Path) -> None:
        """Fetches all that is in a folder there into a folder here.

        Raises:
            UserError: if a file cannot be read there.
            OSError, tarfile.TarError: if one cannot be written here.
            ConnectionLost: if the connection goes.
        """
        code, data, error = self.run(["tar", "-c", "-f", "-", "-C", there, "."])
        if code:
            raise file_error(error, there, self._address)
        with tarfile.open(fileobj=io.BytesIO(data)) as archive:
            archive.extractall(here, filter="data")
