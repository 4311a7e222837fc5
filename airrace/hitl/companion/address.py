"""Where the autonomy runs: ``--companion local`` or ``user@host[:port]``."""

import dataclasses
import ipaddress
import re

from airrace.common.errors import UserError

_FORM = "local or user@host[:port], such as user@10.0.0.2 or user@[fe80::2%eth0]:2222"


@dataclasses.dataclass(frozen=True)
class Address:
    """An ssh server and a user on it."""

    user: str  # to log in as
    host: str  # a name (also one of ~/.ssh/config) or an address, without brackets
    port: int | None = None  # the TCP port; None: ssh's own, 22 or what ~/.ssh/config says

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.user}@{host}" + (f":{self.port}" if self.port else "")

    @property
    def ssh_arguments(self) -> str:
        """What follows ``ssh`` or ``ssh-copy-id`` on a command line to get there."""
        return (f"-p {self.port} " if self.port else "") + f"{self.user}@{self.host}"


def parse_address(text: str) -> Address | None:
    """Returns the Address that --companion names; None for ``local``.

    An IPv6 address stands in brackets if a port follows it.

    Raises UserError if it is neither.
    """
    if text == "local":
        return None
    user, _, rest = text.rpartition("@")
    if not re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.+-]*", user):
        raise UserError(f"--companion '{text}' names no user; give {_FORM}.")
    match = re.fullmatch(r"(?:\[([^\[\]]+)\]|([^\[\]:]*))(?::([^:]*))?", rest)
    v6, name, port = match.groups() if match else (rest, "", None)
    if not (_is_ipv6(v6) if v6 else re.fullmatch(r"(?!.*\.\.)[A-Za-z0-9_][A-Za-z0-9_.-]*", name)):
        raise UserError(f"--companion '{text}' names no host; give {_FORM}.")
    if port is not None and not (re.fullmatch(r"[0-9]{1,5}", port) and 0 < int(port) < 65536):
        raise UserError(f"--companion '{text}' has no port from 1 to 65535 in it; give {_FORM}.")
    return Address(user, v6 or name, port and int(port))  # type: ignore[arg-type]


def _is_ipv6(text: str) -> bool:
    """Whether a text is an address in which nothing is read by a shell or ssh."""
    try:
        scope = ipaddress.IPv6Address(text).scope_id or ""
    except ValueError:
        return False
    return re.fullmatch(r"[\w.-]*", scope, re.ASCII) is not None
