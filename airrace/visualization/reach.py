"""How a page that is served on this computer is reached from where somebody sits."""

import getpass
import ipaddress
import os
import urllib.parse
from collections.abc import Iterator, Mapping

from airrace.common.words import printable


def lines(url: str, environment: Mapping[str, str] = os.environ) -> list[str]:
    """Returns lines that say where a page can be watched, and how if that is not from here.

    Args:
        url: of the page, on loopback.
        environment: variables, by which computers without a screen are told.
    """
    port = urllib.parse.urlsplit(url).port
    return [
        f"Watch it at {url}",
        *_by_ssh(port, environment),
        *_in_codespaces(port, environment),
        *_in_jupyter(port, environment),
    ]


def _by_ssh(port: int | None, environment: Mapping[str, str]) -> Iterator[str]:
    if environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY"):
        return  # a browser can be opened here
    try:  # from where, its port, to where, its port
        _, _, host, ssh_port = environment["SSH_CONNECTION"].split()
        user, host = getpass.getuser(), str(ipaddress.ip_address(host.partition("%")[0]))
        ssh = "ssh" if int(ssh_port) == 22 else f"ssh -p {int(ssh_port)}"
    except (KeyError, ValueError, OSError):
        return  # nobody has come by ssh, or it is not known who
    yield (
        f"From your own computer, by: {ssh} -N -L {port}:localhost:{port} {printable(user)}@{host}"
    )


def _in_codespaces(port: int | None, environment: Mapping[str, str]) -> Iterator[str]:
    name = environment.get("CODESPACE_NAME")
    domain = environment.get("GITHUB_CODESPACES_PORT_FORWARDING_DOMAIN", "app.github.dev")
    if name:
        yield (
            f"In a browser's codespace at https://{printable(name)}-{port}.{printable(domain)}, "
            "if you have started with that as --allow_origin"
        )


def _in_jupyter(port: int | None, environment: Mapping[str, str]) -> Iterator[str]:
    prefix = environment.get("JUPYTERHUB_SERVICE_PREFIX")
    if prefix:
        yield (
            f"Through your hub (with jupyter-server-proxy) at {printable(prefix)}proxy/{port}/, "
            "if you have started with the hub's address as --allow_origin"
        )
