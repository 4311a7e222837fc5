"""What an entry's process does before the entry's code runs."""

import shutil

import pytest

from airrace.league.entry_process import copy_if_there


def test_machine_code_that_goes_meanwhile_is_left_out_and_no_other_fault_is_hidden(tmp_path):
    (tmp_path / "a").write_bytes(b"code")
    copy_if_there(str(tmp_path / "a"), str(tmp_path / "b"))
    assert (tmp_path / "b").read_bytes() == b"code"
    copy_if_there(str(tmp_path / "gone"), str(tmp_path / "c"))
    assert not (tmp_path / "c").exists()
    (tmp_path / "d").mkdir()
    with pytest.raises(OSError) as raised:
        shutil.copytree(tmp_path / "d", tmp_path / "b", copy_function=copy_if_there)
    assert not isinstance(raised.value, FileNotFoundError)
