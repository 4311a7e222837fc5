import getpass

import pytest

from airrace.visualization import reach

URL = "http://localhost:7101"
SSH = "192.0.2.7 50022 198.51.100.3 22"


def other_lines(**environment):
    first, *others = reach.lines(URL, environment)
    assert first == f"Watch it at {URL}"
    return others


def test_who_sits_at_it_is_told_the_address_only():
    assert other_lines() == other_lines(DISPLAY=":0", SSH_CONNECTION=SSH) == []
    assert other_lines(WAYLAND_DISPLAY="wayland-0", SSH_CONNECTION=SSH) == []


@pytest.mark.parametrize(
    "connection, command",
    [
        (SSH, "ssh -N -L 7101:localhost:7101 {user}@198.51.100.3"),
        (SSH + "22", "ssh -p 2222 -N -L 7101:localhost:7101 {user}@198.51.100.3"),
        ("fe80::1%eth0 50022 fe80::2%eth0 22", "ssh -N -L 7101:localhost:7101 {user}@fe80::2"),
    ],
)
def test_who_has_come_by_ssh_is_told_the_way(connection, command):
    (line,) = other_lines(SSH_CONNECTION=connection)
    assert line.endswith(": " + command.format(user=getpass.getuser()))


@pytest.mark.parametrize("text", ["", "1 2 3", "a 1 $(reboot) 22", "1.2.3.4 5 1.2.3.4 x"])
def test_what_is_no_connection_is_passed_over(text):
    assert other_lines(SSH_CONNECTION=text) == []


def test_proxies_are_told_of():
    (line,) = other_lines(CODESPACE_NAME="fuzzy\x1b[2Jname")
    assert "https://fuzzy\\x1b[2Jname-7101.app.github.dev" in line and "--allow_origin" in line
    (line,) = other_lines(JUPYTERHUB_SERVICE_PREFIX="/user/someone/")
    assert "/user/someone/proxy/7101/" in line and "--allow_origin" in line
