import zipfile

import pytest

import airrace
from airrace.common.errors import UserError
from airrace.hitl.companion import wheel as wheel_module
from airrace.hitl.companion.wheel import build_wheel, checkout_path, digest, source_digest
from tests.hitl.companion.fake_checkout import ROOT, make_checkout


def test_wheel_of_this_checkout_has_all_that_a_race_needs(tmp_path):
    before = digest(ROOT / "airrace", ROOT / "models")
    wheel = build_wheel(ROOT, tmp_path)
    names = zipfile.ZipFile(wheel).namelist()
    assert wheel.name.endswith("-py3-none-any.whl")
    modules = {path.relative_to(ROOT).as_posix() for path in (ROOT / "airrace").rglob("*.py")}
    assert modules <= set(names)
    assert {"airrace/hitl/companion/board.sh", "airrace/analysis/templates/report.html"} <= set(
        names
    )
    models = {
        f"airrace/{path.relative_to(ROOT).as_posix()}"
        for path in (ROOT / "models").rglob("*")
        if path.is_file()
    }
    assert models <= set(names)
    assert digest(ROOT / "airrace", ROOT / "models") == before
    assert not (ROOT / "build").exists() and not list(ROOT.glob("*.egg-info"))


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


def test_digest_tells_names_and_contents_apart(tmp_path):
    for folder, files in {"1": {"a": "bc"}, "2": {"ab": "c"}, "3": {"a": "b", "c": ""}}.items():
        (tmp_path / folder / "x").mkdir(parents=True)
        for name, text in files.items():
            (tmp_path / folder / "x" / name).write_text(text)
    assert len({digest(tmp_path / folder / "x") for folder in "123"}) == 3


def test_failures_are_one_sentence(tmp_path, monkeypatch):
    checkout, _ = make_checkout(tmp_path / "c")
    (tmp_path / "w").mkdir()
    (checkout / "LICENSE").unlink()
    with pytest.raises(UserError, match="cannot be built .*LICENSE"):
        build_wheel(checkout, tmp_path / "w")
    (checkout / "LICENSE").touch()
    monkeypatch.setattr(wheel_module, "_BUILD", "import no_setuptools")
    (tmp_path / "v").mkdir()
    with pytest.raises(UserError, match="no_setuptools.*remove .venv and run ./run.bash again"):
        build_wheel(checkout, tmp_path / "v")


def test_checkout(tmp_path, monkeypatch):
    assert checkout_path() == ROOT
    monkeypatch.setattr(airrace, "__file__", str(tmp_path / "site-packages/airrace/__init__.py"))
    with pytest.raises(UserError, match="is no checkout"):
        checkout_path()
