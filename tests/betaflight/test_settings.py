"""Settings are given to the firmware and read back; what it refuses is named."""

import os

import pytest

from airrace.betaflight.settings import configure, lines_of, values_of
from airrace.common.errors import UserError


def test_the_shipped_settings_are_all_taken(configured, shipped):
    _, dump, refused = configured
    assert refused == []
    assert dump.startswith("# version\n# Betaflight / SITL") and dump.endswith("batch end\n")
    values = values_of(dump)
    given = [line.split(" ", 3) for line in lines_of(shipped) if line.startswith("set ")]
    for _, name, _, value in given:
        assert values[name] == value


def test_lines_that_are_refused_are_named(firmware, tmp_path):
    (tmp_path / "team.txt").write_text(
        "# diff all\nbatch start\nset p_roll = 44\nset no_such_thing = 3\nset p_pitch = 9999\n"
        "nonsense\nsave\n"
    )
    (tmp_path / "kept").mkdir()
    dump, refused = configure(firmware, tmp_path / "team.txt", tmp_path / "kept")
    assert values_of(dump)["p_roll"] == "44"
    assert [each.line for each in refused] == [
        "set no_such_thing = 3", "set p_pitch = 9999", "nonsense"
    ]  # fmt: skip
    assert "invalid name" in str(refused[0])


def test_settings_that_are_none_are_refused(firmware, tmp_path):
    path = tmp_path / "team.txt"
    path.write_text("<html>\nNot found\n")
    with pytest.raises(UserError, match="takes none of the 2 lines of .*team.txt"):
        configure(firmware, path, tmp_path)
    path.write_bytes(b"\x89PNG\xff\xfe")
    with pytest.raises(UserError, match="is no text"):
        lines_of(path)
    path.write_text("# nothing\nbatch start\nEXIT\nSave\n")
    with pytest.raises(UserError, match="holds no settings"):
        lines_of(path)
    for much in ("set p_roll = 44\n" * 5001, "#" * 1_100_000 + "\nset p_roll = 44\n"):
        path.write_text(much)
        with pytest.raises(UserError, match="too long to be settings"):
            lines_of(path)
    os.mkfifo(tmp_path / "pipe.txt")  # nobody writes it
    for what in ("missing.txt", "pipe.txt", ""):
        with pytest.raises(UserError, match="cannot be read"):
            lines_of(tmp_path / what)


def test_a_firmware_that_does_not_run_names_the_remedy(firmware, shipped, tmp_path):
    broken = tmp_path / "broken"
    for text, words in (("no program", "Exec format error"), ("#!/bin/false\n", "exit code 1")):
        broken.write_text(text)
        broken.chmod(0o755)
        with pytest.raises(UserError, match=rf"{words}.*build --again"):
            configure(firmware._replace(program=broken), shipped, tmp_path)


def test_a_line_that_ends_the_firmware_is_named(firmware, tmp_path):
    (tmp_path / "team.txt").write_text("set p_roll = 44\ndefaults\n")
    (tmp_path / "kept").mkdir()
    with pytest.raises(UserError, match="exit code 0, after 'defaults' of its settings"):
        configure(firmware, tmp_path / "team.txt", tmp_path / "kept")
