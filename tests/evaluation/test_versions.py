import numpy as np
import pytest

from airrace.evaluation.versions import mismatch, versions


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "my_team.py").write_text("raise RuntimeError('imported')\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_names_what_flies():
    found = versions({})
    assert list(found) == ["airrace", "drake", "numpy", "opencv"]
    assert found["numpy"] == np.__version__ and found == versions({})


def test_a_changed_box_is_another_version(folder):
    systems = {"explorer": "my_team:make", "lap_planner": "my_team:other"}
    before = versions(systems)
    assert mismatch(before, versions(systems)) is None
    (folder / "my_team.py").write_text("# better\n")
    assert mismatch(before, versions(systems)).startswith("my_team ")
    (folder / "my_team.py").unlink()
    assert mismatch(before, versions(systems)).startswith("my_team missing instead of ")


def test_packages_count_with_all_their_modules(folder):
    (folder / "team" / "deep").mkdir(parents=True)
    (folder / "team" / "__init__.py").touch()
    (folder / "team" / "deep" / "box.py").touch()
    before = versions({"explorer": "team.deep.box:make"})
    (folder / "team" / "deep" / "box.py").write_text("pass")
    assert mismatch(before, versions({"explorer": "team.deep.box:make"})).startswith("team ")


def test_mismatch_names_both():
    assert mismatch({"numpy": "2.1"}, {"numpy": "2.2"}) == "numpy 2.2 instead of 2.1"
    assert mismatch({"numpy": "2.1"}, {}) == "numpy missing instead of 2.1"
