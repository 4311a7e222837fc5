import pytest

from airrace.common.errors import UserError
from airrace.hitl.command import HitlOptions, ssh_companions
from airrace.hitl.companion.address import Address
from airrace.hitl.companion.ssh_companion import SshCompanion
from tests.worlds.command_line import parse as parse_race


def parse(*words) -> HitlOptions:
    return parse_race("race", ["-s", "HITL", *words])


def test_options_reach_the_companion(tmp_path):
    (tmp_path / "key").touch()
    make = ssh_companions(
        parse(*f"--companion user@board --identity {tmp_path / 'key'} --wheels {tmp_path}".split())
    )
    companion = make(Address("pilot", "board", 2222))
    assert isinstance(companion, SshCompanion)
    assert companion.address == Address("pilot", "board", 2222)
    companion.close()  # nothing was connected


def test_they_may_be_left_out():
    for words in ([], ["--companion", "none"], ["--companion", "a@b"]):
        assert callable(ssh_companions(parse(*words)))


@pytest.mark.parametrize(
    "words, match",
    [
        (["--companion", "10.0.0.2"], "names no user"),
        (["--companion", "local", "--wheels", "."], "--wheels is for a companion"),
        (["--companion", "none", "--wheels", "."], "--wheels is for a companion"),
        (["--identity", "key"], "--identity is for a companion"),
        (["--wheels", "."], "add -s HITL"),
        (["--companion", "a@b", "--identity", "no/such/key"], "no/such/key is no file"),
        (["--companion", "a@b", "--wheels", "no/such/folder"], "no/such/folder is no folder"),
    ],
)
def test_bad_options(words, match):
    with pytest.raises(UserError, match=match):
        ssh_companions(parse(*words))
