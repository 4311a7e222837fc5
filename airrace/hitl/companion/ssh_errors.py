"""What went wrong with ssh, in a sentence that says what to do."""

import asyncio
import contextlib
import errno
import os
import shlex
import socket
from pathlib import Path

import asyncssh

from airrace.common.errors import UserError, words
from airrace.common.patience import patient
from airrace.hitl.companion.address import Address

_NO_SERVER = (
    asyncssh.ConnectionLost,
    asyncssh.ProtocolError,
    asyncssh.ProtocolNotSupported,
    asyncssh.KeyExchangeFailed,
    ConnectionResetError,
)
_KEY_TIMEOUT = 10.0  # s


async def connect_error(
    error: Exception,
    address: Address,
    identity: Path | None,
    options: asyncssh.SSHClientConnectionOptions | None,
) -> UserError:
    """Returns the UserError for a connection that could not be made.

    Args:
        identity: the key that the user named, or None.
        options: asyncssh.SSHClientConnectionOptions; None if error came of making them.
    """
    host, ssh, said = address.host, address.ssh_arguments, words(error)
    if isinstance(error, socket.gaierror):
        return UserError(
            f"There is no host named {host}; correct --companion, or name it in "
            "/etc/hosts or ~/.ssh/config."
        )
    if options is None and identity is not None:
        return UserError(
            f"--identity {identity} cannot be used ({said}); name the file of a "
            "private key, or add one with a passphrase to the agent with 'ssh-add' and "
            "leave --identity out."
        )
    if options is None:
        return UserError(
            f"Your keys or ~/.ssh/config cannot be used ({said}); see that 'ssh {ssh}' works."
        )
    port = options.port or 22
    is_known = _is_known(options)
    if isinstance(error, asyncssh.PermissionDenied):
        key = f" -i {shlex.quote(str(identity))}" if identity else ""
        make = "" if identity or _has_key() else "make a key with 'ssh-keygen' and "
        return UserError(
            f"{host} refuses your ssh key for the user {address.user}; {make}"
            f"bring it there with 'ssh-copy-id{key} {ssh}'."
        )
    if isinstance(error, asyncssh.HostKeyNotVerifiable) and not is_known:
        return UserError(
            f"The host key of {host} is not known here; run 'ssh {ssh}' once, compare the "
            "fingerprint, and accept it."
        )
    # A server without a key of the kinds that known_hosts has breaks off.
    if isinstance(error, asyncssh.HostKeyNotVerifiable) or (
        is_known and isinstance(error, _NO_SERVER) and await _has_a_key(address)
    ):
        name = shlex.quote(host if port == 22 else f"[{host}]:{port}")
        return UserError(
            f"The host key of {host} has CHANGED: this is another machine, or one set up "
            f"anew; if you know why, forget the old key with 'ssh-keygen -R {name}' and "
            f"accept the new one with 'ssh {ssh}'."
        )
    refused = f"[Errno {errno.ECONNREFUSED}]"  # where a name stands for several addresses
    if isinstance(error, ConnectionRefusedError) or refused in str(error):
        return UserError(
            f"Nothing listens on port {port} of {host}; start the ssh server there "
            "('sudo apt-get install openssh-server'), or correct the port in --companion."
        )
    if isinstance(error, _NO_SERVER):
        return UserError(
            f"What answers on port {port} of {host} is no ssh server that lets one "
            f"in ({said}); correct the port in --companion."
        )
    if isinstance(error, OSError):
        said = "no answer" if isinstance(error, TimeoutError) and not str(error) else said
        return UserError(
            f"{host} cannot be reached ({said}); see that it is switched "
            f"on, that the cable is plugged in, and that 'ping {host}' works."
        )
    return UserError(f"The ssh connection to {host} failed ({said}); see that 'ssh {ssh}' works.")


def _is_known(options: asyncssh.SSHClientConnectionOptions) -> bool:
    """Whether known_hosts has any key of the host of asyncssh.SSHClientConnectionOptions."""
    files = options.known_hosts or Path("~/.ssh/known_hosts").expanduser()
    port = None if (options.port or 22) == 22 else options.port
    try:
        found = asyncssh.match_known_hosts(
            files if isinstance(files, (bytes, list, tuple)) else str(files),
            options.host_key_alias or options.host,
            "",
            port,
        )
    except (OSError, ValueError):
        return False
    return any(found[:3])  # host keys, keys of authorities, revoked keys


async def _has_a_key(address: Address) -> bool:
    """Whether a server has a host key of any kind."""
    with contextlib.suppress(OSError, asyncssh.Error):
        key = asyncssh.get_server_host_key(address.host, address.port or ())
        return await asyncio.wait_for(key, patient(_KEY_TIMEOUT)) is not None
    return False


def _has_key() -> bool:
    return bool(os.environ.get("SSH_AUTH_SOCK")) or any(Path("~/.ssh").expanduser().glob("id_*"))


def file_error(said: str, path: str, address: Address) -> UserError:
    """Returns the UserError for a file that could not be written or read there.

    Args: said: what the program that failed has said. path: of a file or folder there.
    """
    if is_disk_full(said):
        return UserError(f"The disk of {address.host} is full at {path}; make room there.")
    return UserError(
        f"{path} on {address.host} cannot be used ({last_line(said)}); see that "
        f"{address.user} may write there."
    )


def is_disk_full(said: str) -> bool:
    """Whether a program's output says that it found no room."""
    return "No space left" in said or "quota exceeded" in said


def last_line(output: str) -> str:
    """Returns the last line that says something, pip's errors first, not too long."""
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    errors = [line for line in lines if line.startswith("ERROR")]
    text = (errors or lines or ["it says nothing"])[-1].removeprefix("ERROR: ")
    return text.rstrip(".")[:300]
