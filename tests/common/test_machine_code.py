"""Where machine code is kept: each test has a small package, a home and a temporary folder."""

import os
import tempfile
from pathlib import Path

import pytest

from airrace.common.machine_code import choose_folder, sources_digest


@pytest.fixture
def package(tmp_path, monkeypatch):
    package = tmp_path / "installed/package"
    package.mkdir(parents=True)
    (package / "inner.py").write_text("from airrace.common.jit import compiled\n")
    for name in ("home", "temporary", "xdg"):
        (tmp_path / name).mkdir()
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    return package


@pytest.fixture
def forbid(monkeypatch):
    """Makes that nothing can be written below a folder, for root neither."""
    forbidden, access = [], os.access

    def may(path, mode):
        return not any(path.is_relative_to(each) for each in forbidden) and access(path, mode)

    monkeypatch.setattr(os, "access", may)
    return forbidden.append


def name(package):
    return f"machine_code-{sources_digest(package)}"


def test_it_is_beside_the_byte_code(package):
    assert choose_folder(package) == package / "__pycache__" / name(package)


def test_an_installation_of_another_user_is_left_alone(package, tmp_path, forbid, monkeypatch):
    forbid(tmp_path / "installed")
    assert choose_folder(package) == tmp_path / "home/.cache/airrace" / name(package)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert choose_folder(package) == tmp_path / "xdg/airrace" / name(package)
    assert not (package / "__pycache__").exists()


def test_what_was_compiled_at_the_installation_is_taken_along(package, tmp_path, forbid):
    kept = package / "__pycache__" / name(package) / "airrace.math/a.nbc"
    kept.parent.mkdir(parents=True)
    kept.write_bytes(b"code")
    forbid(tmp_path / "installed")
    folder = choose_folder(package)
    assert (folder / "airrace.math/a.nbc").read_bytes() == b"code"
    kept.write_bytes(b"other")
    assert choose_folder(package) == folder
    assert (folder / "airrace.math/a.nbc").read_bytes() == b"code"
    assert [each.name for each in folder.parent.iterdir()] == [name(package)]


def test_a_cache_that_is_hidden_from_this_user_is_none(package, tmp_path, forbid, monkeypatch):
    forbid(tmp_path / "installed")
    monkeypatch.setattr(os.path, "exists", lambda path: "xdg" not in str(path))
    monkeypatch.setattr(Path, "exists", pytest.fail)  # raises PermissionError there
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    assert choose_folder(package).is_relative_to(tmp_path / "temporary")


def test_without_a_home_it_is_in_a_temporary_folder_of_ones_own(package, tmp_path, forbid):
    forbid(tmp_path / "installed")
    forbid(tmp_path / "home")
    folder = choose_folder(package)
    assert folder == tmp_path / "temporary" / f"airrace-{os.getuid()}" / name(package)
    assert folder.parent.stat().st_mode & 0o777 == 0o700
    assert choose_folder(package) == folder
    # Whose folder it was might have put something into it.
    folder.parent.chmod(0o777)
    assert not choose_folder(package).is_relative_to(folder.parent)
    folder.parent.rmdir()
    folder.parent.symlink_to(tmp_path / "xdg")
    assert not choose_folder(package).is_relative_to(tmp_path / "xdg")
