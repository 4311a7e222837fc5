"""An ssh connection for code that is not asynchronous: commands, files, processes.

Keys only, host keys checked against known_hosts, ~/.ssh/config and the ssh agent
heeded, all by asyncssh. Its event loop runs in a thread of its own.
"""

import asyncio
import contextlib
import secrets
import shlex
import threading
from collections.abc import Callable
from pathlib import Path

import asyncssh

from airrace.hitl.companion.address import Address
from airrace.hitl.companion.ssh_errors import connect_error, is_known, transfer_error

_CONNECT_TIMEOUT = 10  # s
_LOGIN_TIMEOUT = 20  # s
_KEEPALIVE = 5  # s; after three of them without an answer the connection is lost


class ConnectionLost(Exception):
    """The ssh connection has gone; the message is a clause that says why."""


class SshConnection:
    """A connection to a companion computer; a context manager that closes it."""

    def __init__(self, address: Address, identity: Path | None = None):
        """Connects.

        Args:
            address: of the companion.
            identity: the file of a private key; None: those that ssh would try.

        Raises:
            UserError: if that fails; it names what is wrong and the remedy.
        """
        self._address = address
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self._readers = set()  # the loop itself does not keep its tasks alive
        try:
            self._connection = self._wait(self._connect(identity))
        except BaseException:
            self._end_loop()
            raise

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

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
        except BaseException as e:
            future.cancel()
            if isinstance(
                e,
                (
                    asyncssh.ConnectionLost,
                    asyncssh.ChannelOpenError,
                    ConnectionError,
                    BrokenPipeError,
                ),
            ):
                raise ConnectionLost(str(e).rstrip(".") or type(e).__name__) from None
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
                connect_timeout=_CONNECT_TIMEOUT,
                login_timeout=_LOGIN_TIMEOUT,
                keepalive_interval=_KEEPALIVE,
                keepalive_count_max=3,
                **more,
            )
            return await asyncssh.connect(address.host, options=options)
        except (OSError, asyncssh.Error, ValueError) as e:
            if options is not None and is_known(options) and await self._has_other_keys(e):
                e = asyncssh.HostKeyNotVerifiable("none of its keys is known")
            raise connect_error(e, address, identity, options) from None

    async def _has_other_keys(self, error) -> bool:
        """Whether a server broke off since it has no key of the kinds that known_hosts has."""
        if not isinstance(
            error, (ConnectionResetError, asyncssh.ConnectionLost, asyncssh.KeyExchangeFailed)
        ):
            return False
        address = self._address
        with contextlib.suppress(OSError, asyncssh.Error):
            return (
                await asyncio.wait_for(
                    asyncssh.get_server_host_key(address.host, address.port or ()), _CONNECT_TIMEOUT
                )
                is not None
            )
        return False

    def run(self, arguments: list[str], text: str = "") -> tuple[int, str, str]:
        """Runs a command to its end.

        Args:
            arguments: of the command; each reaches it as it is.
            text: its standard input.

        Returns:
            exit code (-1: none), standard output, standard error.

        Raises:
            ConnectionLost: if the connection goes.
        """
        return self._wait(self._run(arguments, text))

    async def _run(self, arguments, text):
        done = await self._connection.run(shlex.join(arguments), input=text, errors="replace")
        if done.returncode is None and self._connection.is_closed():
            raise asyncssh.ConnectionLost("it ended in a command")
        code = -1 if done.returncode is None else done.returncode
        return code, done.stdout, done.stderr

    def start(
        self, arguments: list[str], text: str, on_line: Callable[[str | None], None]
    ) -> Callable[[str], None]:
        """Starts a command.

        Args:
            arguments: of the command; each reaches it as it is.
            text: what it finds on its standard input, which stays open.
            on_line: called, in another thread, with every line that it writes,
                to standard output or error, and with None when there are no more.

        Returns:
            a function that sends more text to its standard input.

        Raises:
            ConnectionLost: if the connection goes.
        """
        process = self._wait(self._start(shlex.join(arguments), on_line))

        async def write(text):
            process.stdin.write(text)
            await process.stdin.drain()

        self._wait(write(text))
        return lambda text: self._wait(write(text))

    async def _start(self, command, on_line):
        process = await self._connection.create_process(
            command, stderr=asyncssh.STDOUT, errors="replace"
        )

        async def read():
            with contextlib.suppress(asyncssh.Error, OSError):
                async for line in process.stdout:
                    on_line(line.rstrip("\n"))
            on_line(None)

        self._readers.add(reader := asyncio.create_task(read()))
        reader.add_done_callback(self._readers.discard)
        return process

    def put(self, files: dict[str, Path], progress: Callable[[int], None] = lambda n: None):
        """Brings files over; those that are there, of the same size, are left alone.

        A file is there under its name as a whole or not at all.

        Args:
            files: path there to path here; folders there are made as needed.
            progress: called with the number of bytes brought over, file by file.

        Raises:
            UserError: if a file cannot be read here, or written there.
            ConnectionLost: if the connection goes.
        """
        self._wait(self._transfer(self._put, files, progress))

    async def _put(self, sftp, files, progress):
        for there, here in files.items():
            size = (await asyncio.to_thread(here.stat)).st_size
            if not (await sftp.exists(there) and await sftp.getsize(there) == size):
                await sftp.makedirs(there.rpartition("/")[0], exist_ok=True)
                part = f"{there}.{secrets.token_hex(4)}.part"
                await sftp.put(str(here), part)
                await sftp.posix_rename(part, there)
            progress(size)

    def get(self, there: str, here: Path) -> None:
        """Fetches all that is in a folder there into a folder here.

        Raises:
            UserError: if a file cannot be read there, or written here.
            ConnectionLost: if the connection goes.
        """
        self._wait(self._transfer(self._get, there, here))

    async def _get(self, sftp, there, here):
        names = [name for name in await sftp.listdir(there) if name not in (".", "..")]
        for name in sorted(names):
            await sftp.get(f"{there}/{name}", str(here / name), recurse=True)

    def remove(self, folder: str) -> None:
        """Removes a folder there and all that is in it, if there is one."""
        self._wait(self._transfer(self._remove, folder))

    async def _remove(self, sftp, folder):
        await sftp.rmtree(folder, ignore_errors=True)

    async def _transfer(self, do, *arguments):
        there = arguments[0]
        try:
            async with self._connection.start_sftp_client() as sftp:
                try:
                    return await do(sftp, *arguments)
                except asyncssh.SFTPConnectionLost:
                    raise asyncssh.ConnectionLost("it ended in a transfer") from None
                except (asyncssh.SFTPError, OSError) as e:
                    folder = there if isinstance(there, str) else next(iter(there), ".")
                    raise await transfer_error(e, sftp, folder, self._address) from None
        except asyncssh.ChannelOpenError as e:
            if self._connection.is_closed():
                raise
            raise await transfer_error(e, None, "", self._address) from None
