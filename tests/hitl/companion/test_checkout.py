from pathlib import Path

import pytest

from airrace.common.errors import UserError
from airrace.hitl.companion import set_up
from airrace.hitl.companion.set_up import checkout_path, source_digest, source_files
from tests.hitl.companion.fake_checkout import ROOT, make_checkout


def test_what_is_brought_has_all_that_a_race_needs():
    names = set(source_files(ROOT))
    for folder in ("airrace", "models"):
        files = {
            path.relative_to(ROOT).as_posix()
            for path in (ROOT / folder).rglob("*")
            if path.is_file() and "__pycache__" not in path.parts
        }
        assert files <= names
    assert "airrace/hitl/companion/board.sh" in names
    assert not any("__pycache__" in name for name in names)


def test_changes_that_are_not_committed_count(tmp_path):
    checkout, _ = make_checkout(tmp_path)
    first = source_digest(checkout)
    (checkout / "airrace" / "__pycache__").mkdir()
    (checkout / "airrace" / "__pycache__" / "x.pyc").touch()
    (checkout / "notes.txt").touch()
    assert source_digest(checkout) == first
    (checkout / "airrace" / "new.py").touch()
    second = source_digest(checkout)
    assert second != first
    (checkout / "airrace" / "new.py").rename(checkout / "airrace" / "newer.py")
    assert source_digest(checkout) not in (first, second)


def test_failures_are_one_sentence(tmp_path, monkeypatch):
    checkout, _ = make_checkout(tmp_path)

    def refuse(path):
        raise OSError(5, "Input/output error", str(path))

    monkeypatch.setattr(Path, "read_bytes", refuse)
    with pytest.raises(UserError, match="__init__.py cannot be read .*; mend the checkout in"):
        source_files(checkout)


def test_checkout(tmp_path, monkeypatch):
    assert checkout_path() == ROOT
    monkeypatch.setattr(set_up, "PACKAGE", tmp_path / "site-packages/airrace")
    with pytest.raises(UserError, match="is no checkout"):
        checkout_path()
