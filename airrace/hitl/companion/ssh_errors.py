"""What went wrong with ssh, in a sentence that says what to do."""

import errno
import os
import shlex
import socket
from pathlib import Path

import asyncssh

from airrace.common.errors import UserError
from airrace.hitl.companion.address import Address


def connect_error(error: Exception, address: Address, identity: Path | None, options) -> UserError:
    """Returns the UserError for a connection that could not be made.

    Args:
        error: that asyncssh raised.
        address: of the companion.
        identity: the key that the user named, or None.
        options: asyncssh.SSHClientConnectionOptions; None if error came of making them.
    """
    host, ssh = address.host, address.ssh_arguments
    if isinstance(error, socket.gaierror):
        return UserError(
            f"There is no host named {host}; correct --companion, or name it in "
            "/etc/hosts or ~/.ssh/config."
        )
    if options is None:
        if identity is not None:
            return UserError(
                f"--identity {identity} cannot be used ({_words(error)}); name the file of a "
                "private key, or add one with a passphrase to the agent with 'ssh-add' and "
                "leave --identity out."
            )
        return UserError(
            f"Your keys or ~/.ssh/config cannot be used ({_words(error)}); see that "
            f"'ssh {ssh}' works."
        )
    if isinstance(error, asyncssh.PermissionDenied):
        key = f" -i {shlex.quote(str(identity))}" if identity else ""
        make = "" if identity or _has_key() else "make a key with 'ssh-keygen' and "
        return UserError(
            f"{host} refuses your ssh key for the user {address.user}; {make}"
            f"bring it there with 'ssh-copy-id{key} {ssh}'."
        )
    if isinstance(error, asyncssh.HostKeyNotVerifiable):
        return _host_key_error(address, options)
    port = options.port or 22
    refused = f"[Errno {errno.ECONNREFUSED}]"  # where a name stands for several addresses
    if isinstance(error, ConnectionRefusedError) or refused in str(error):
        return UserError(
            f"Nothing listens on port {port} of {host}; start the ssh server there "
            "('sudo apt-get install openssh-server'), or correct the port in "
            "--companion."
        )
    if isinstance(
        error,
        (
            asyncssh.ConnectionLost,
            asyncssh.ProtocolError,
            asyncssh.ProtocolNotSupported,
            ConnectionResetError,
        ),
    ):
        return UserError(
            f"What answers on port {port} of {host} is no ssh server that lets one "
            f"in ({_words(error)}); correct the port in --companion."
        )
    if isinstance(error, (TimeoutError, OSError)):
        return UserError(
            f"{host} cannot be reached ({_words(error)}); see that it is switched "
            f"on, that the cable is plugged in, and that 'ping {host}' works."
        )
    return UserError(
        f"The ssh connection to {host} failed ({_words(error)}); see that 'ssh {ssh}' works."
    )


def _host_key_error(address, options):
    name = address.host if (options.port or 22) == 22 else f"[{address.host}]:{options.port}"
    if is_known(options):
        return UserError(
            f"The host key of {address.host} has CHANGED: this is another machine, or one set up "
            "anew; if you know why, forget the old key with "
            f"'ssh-keygen -R {shlex.quote(name)}' and accept the new one with "
            f"'ssh {address.ssh_arguments}'."
        )
    return UserError(
        f"The host key of {address.host} is not known here; run "
        f"'ssh {address.ssh_arguments}' once, compare the fingerprint, and accept it."
    )


def is_known(options) -> bool:
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


def _has_key() -> bool:
    return bool(os.environ.get("SSH_AUTH_SOCK")) or any(Path("~/.ssh").expanduser().glob("id_*"))


async def transfer_error(error: Exception, sftp, path: str, address: Address) -> UserError:
    """Returns the UserError for a file that could not be brought over or fetched.

    Args:
        error: that asyncssh or the file system here raised.
        sftp: an open SFTP client, to look for the reason with, or None.
        path: of a file or folder there.
        address: of the companion.
    """
    if isinstance(error, OSError):
        return UserError(
            f"{error.filename or 'A file'} here cannot be used ({error.strerror}); "
            "see that it is there and that the disk is not full."
        )
    if sftp is None:
        return UserError(
            f"The ssh server of {address.host} has no SFTP ({_words(error)}); install "
            "openssh-sftp-server there."
        )
    if await _is_full(sftp, path):
        return UserError(f"The disk of {address.host} is full at {path}; make room there.")
    return UserError(
        f"{path} on {address.host} cannot be used ({_words(error)}); see that "
        f"{address.user} may write there."
    )


async def _is_full(sftp, path) -> bool:
    """Whether the file system of a path has nothing left; OpenSSH says only "failure"."""
    while path:
        try:
            return (await sftp.statvfs(path)).bavail < 16
        except asyncssh.SFTPError:
            path = path.rpartition("/")[0]
    return False


def _words(error: BaseException) -> str:
    """Returns what an error says, on one line and without a full stop."""
    text = getattr(error, "strerror", None) or str(error)
    if isinstance(error, TimeoutError) and not text:
        return "no answer"
    return (" ".join(text.split()) or type(error).__name__).rstrip(".")[:200]
