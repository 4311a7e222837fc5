import shlex

import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.common.errors import UserError
from airrace.hitl.companion.address import Address, parse_address
from tests.worlds.cases import guarded


@pytest.mark.parametrize(
    "text, user, host, port",
    [
        ("user@10.0.0.2", "user", "10.0.0.2", None),
        ("user@jetson.local:2222", "user", "jetson.local", 2222),
        ("user@fe80::2", "user", "fe80::2", None),
        ("user@fe80::2%eth0", "user", "fe80::2%eth0", None),
        ("user@[fe80::2%eth0]:22", "user", "fe80::2%eth0", 22),
        ("user@[::1]", "user", "::1", None),
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
        "user@",
        "user@:22",
        "user@host:",
        "user@host:0",
        "user@host:65536",
        "user@host:ssh",
        "user@host:-1",
        "user@-oProxyCommand=x",
        "-l@host",
        "user@ho st",
        "user@host;id",
        "user@$(id)",
        "pi'lot@host",
        "user@[host]:22",
        "user@[::1]22",
        "user@[::1",
        "user@fe80::zz",
        "user@a@b@",
        "LOCAL",
        "user@host\n",
        "user@fe80::1%a b",
        "user@..",
        "user@host:٢٢",
    ],
)
def test_refuses_in_one_sentence(text):
    with pytest.raises(UserError) as e:
        parse_address(text)
    assert "--companion" in str(e.value) and "user@host[:port]" in str(e.value)


@guarded
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
