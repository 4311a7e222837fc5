"""Modules are never found for lying in the folder that somebody works in."""

import subprocess
import sys
from pathlib import Path

import pytest

from airrace.common import python_path
from airrace.common.python_path import add_own_systems_folder, forget_working_folder, module_command

# Of Python's own library, of our packages, and what our packages import where it is installed.
NAMES = "yaml", "numba", "json", "typing", "coverage", "bottleneck", "IPython", "drake", "numpy"
TRAP = "raise SystemExit('trap: run from the working folder')\n"


@pytest.fixture
def traps(tmp_path, monkeypatch):
    """The working folder, in which modules and packages lie that end who imports them."""
    for name in NAMES:
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(TRAP)
        (tmp_path / f"{name}.py").write_text(TRAP)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(command, **kwargs):
    done = subprocess.run(command, capture_output=True, text=True, **kwargs)
    assert "trap" not in done.stdout + done.stderr, done.stderr
    return done


def test_the_command_runs_nothing_of_the_working_folder(traps):
    done = run([sys.executable, "-m", "airrace", "track", "--help"])
    assert done.returncode == 0 and "Usage" in done.stdout


def test_neither_the_working_folder_nor_a_checkout_is_on_the_path(tmp_path, monkeypatch):
    root = str(Path(python_path.__file__).parents[2])
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", ["", "/first", str(tmp_path), root, "/last"])
    forget_working_folder()
    assert sys.path == ["/first", "/last"]


def test_a_child_finds_airrace_and_nothing_of_the_working_folder(traps):
    done = run(module_command("airrace.track.command"), cwd=traps)
    assert done.returncode == 0, done.stderr


def test_nor_if_its_parent_does(traps, monkeypatch):
    """As an interactive Python would, whose working folder is the first on its path."""
    monkeypatch.setattr(sys, "path", ["", *sys.path])
    done = run(module_command("bottleneck"), cwd="/")
    assert done.returncode == 1 and "No module named bottleneck" in done.stderr


def test_the_folder_of_what_starts_it_is_not_on_the_path_of_a_child(tmp_path, monkeypatch):
    (tmp_path / "shows.py").write_text("import sys; print(sys.path)\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    done = run(module_command("shows"), cwd="/")
    assert str(tmp_path) in done.stdout
    assert str(Path(python_path.__file__).parent) not in done.stdout


def test_a_child_finds_what_its_parent_does(tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "only_here.py").write_text("import sys; print(sys.argv)\n")
    monkeypatch.syspath_prepend(str(tmp_path / "elsewhere"))
    done = run(module_command("only_here", "a", "b"), cwd="/")
    assert done.stdout.endswith("only_here.py', 'a', 'b']\n"), done.stderr


def test_own_systems_come_last_also_in_a_child(traps, monkeypatch):
    (traps / "my_team.py").write_text("import yaml; print(yaml.__version__)\n")
    monkeypatch.setattr(sys, "path", [place for place in sys.path if place])
    add_own_systems_folder()
    add_own_systems_folder()
    assert sys.path.count(str(traps)) == 1 and sys.path[-1] == str(traps)
    (traps / "elsewhere").mkdir()
    code = "from airrace.common import python_path as p; p.add_own_systems_folder(); import my_team"
    (traps / "elsewhere" / "asks.py").write_text(code)
    sys.path[-1:] = [str(traps / "elsewhere")]
    done = run(module_command("asks"), cwd="/")
    assert done.stdout.startswith("6."), done.stderr
