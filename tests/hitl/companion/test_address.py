import shlex

import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.common.errors import UserError
from airrace.hitl.companion.address import Address, parse_address


@pytest.mark.parametrize(
    "text, user, host, port",
    [
        ("pilot@10.0.0.2", "pilot", "10.0.0.2", None),
        ("pilot@jetson.local:2222", "pilot", "jetson.local", 2222),
        ("pilot@fe80::2", "pilot", "fe80::2", None),
        ("pilot@fe80::2%eth0", "pilot", "fe80::2%eth0", None),
        ("pilot@[fe80::2%eth0]:22", "pilot", "fe80::2%eth0", 22),
        ("pilot@[::1]", "pilot", "::1", None),
        ("p.i-l_ot@board_1", "p.i-l_ot", "board_1", None),
    ],
)
def test_parses(text, user, host, port):
    address = parse_address(text)
    assert address == Address(user, host, port)
    assert parse_address(str(address)) == address


def test_local():
    assert parse_address("local") is None


@pytest.mark.parametrize(
    "text",
    [
        "",
        "10.0.0.2",
        "@10.0.0.2",
        "pilot@",
        "pilot@:22",
        "pilot@host:",
        "pilot@host:0",
        "pilot@host:65536",
        "pilot@host:ssh",
        "pilot@host:-1",
        "pilot@-oProxyCommand=x",
        "-l@host",
        "pilot@ho st",
        "pilot@host;id",
        "pilot@$(id)",
        "pi'lot@host",
        "pilot@[host]:22",
        "pilot@[::1]22",
        "pilot@[::1",
        "pilot@fe80::zz",
        "pilot@a@b@",
        "LOCAL",
        "pilot@host\n",
        "pilot@fe80::1%a b",
        "pilot@..",
        "pilot@host:٢٢",
    ],
)
def test_refuses_in_one_sentence(text):
    with pytest.raises(UserError) as e:
        parse_address(text)
    assert "--companion" in str(e.value) and "user@host[:port]" in str(e.value)


@given(st.text(max_size=30) | st.from_regex(r"\A[a-z-]+@[\[\]a-z0-9:.%$-]+\Z"))
def test_whatever_passes_is_harmless_on_a_command_line(text):
    try:
        address = parse_address(text)
    except UserError:
        return
    if address is not None:
        words = shlex.split(address.ssh_arguments)
        assert shlex.join(words) == address.ssh_arguments or "%" in address.host
        assert not words[-1].startswith("-") and not address.host.startswith("-")
        assert parse_address(str(address)) == address
