"""The notebooks run from top to bottom, and are committed without outputs."""

import json
import re

import pytest

from tests.notebooks.lesson import NOTEBOOKS, ROOT, cells, exercises

# To save time, these lessons' races here have half of the usual pictures, or none and a given map;
# the others', those of lesson 3 for one, have all.
FEWER = "_fewer(options)"
NONE = "_dc.replace(options, map='track', renderer='none')"
PICTURES = {
    "1_first_race": FEWER,
    "5_your_own_box": FEWER,
    "6_compare_and_evaluate": NONE,
    "10_a_pilot_that_learns": NONE,
}
# Before a lesson: notes what it flies, and lets the races of an evaluation be short.
NOTE = """
import dataclasses as _dc
import json as _json

from airrace.commands import python_race
from airrace.diagrams.race.command import RaceOptions, race_scenario

_fly, _folders = python_race.fly, []

def _fewer(options):
    fields = _json.loads(options.scenario_text or "{}")
    camera = {**fields.get("camera", {}), "fps": 15}
    return _dc.replace(options, scenario_text=_json.dumps({**fields, "camera": camera}))

def _note(options, quiet=False):
    result, folder = _fly(PICTURES, quiet)
    _folders.append(folder)
    return result, folder

python_race.fly = _note

# An evaluation in a lesson is of races on a given map.
import subprocess

_run = subprocess.run

def _run_briefly(command, **options):
    given = ["--scenario_text", "{map: track, camera: {renderer: none}}"]
    return _run([*command, *given] if "evaluate" in command else command, **options)

subprocess.run = _run_briefly
"""
# Before its solutions: to fly their races would take minutes. Their options are checked, and the
# lesson's last race, or else a short one, is what they look at.
STAND_IN = """
_SHORT = RaceOptions(
    track="hexagon", laps=1, map="track", renderer="none", meshcat=False, report=False, linger=0.0
)

def _stand_in(options, quiet=False):
    race_scenario(options)
    return {}, _folders[-1] if _folders else _note(_SHORT, quiet=True)[1]

python_race.fly = _stand_in
"""
EXPENSIVE = re.compile(r"\bevaluate\(")  # flies races in processes of their own
# What is learned is learned by half of the drones; solutions do so for three iterations, and fly the
# first two of a series.
FEWER_DRONES = r"\bDRONES, SECONDS = 128\b", "DRONES, SECONDS = 64"
BRIEFLY = (
    (r"\biterations=\d+", "iterations=3"),
    (r"\bfor (\w+) in \(([^(),]+,[^(),]+),[^()]+\)", r"for \1 in (\2)"),
)


def briefly(code: str) -> str:
    """Returns the code of a solution so that it takes less time."""
    for pattern, replacement in BRIEFLY:
        code = re.sub(pattern, replacement, code)
    return code


def test_the_readme_lists_all_lessons_in_their_order():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| \[(\d+) .+?\]\(notebooks/(.+?)\)", text, re.M)
    assert [name for _, name in listed] == [path.name for path in NOTEBOOKS]
    assert all(name.startswith(f"{number}_") for number, name in listed)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_committed_without_outputs(path):
    notebook = json.loads(path.read_text(encoding="utf-8"))
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert all(not cell["outputs"] and cell["execution_count"] is None for cell in code)
    assert not any(cell["metadata"] for cell in notebook["cells"])


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_uses_airrace_alone_of_this_checkout(path):
    text = path.read_text(encoding="utf-8")
    for folder in ("benchmarks", "tests", "tools"):
        assert f"import {folder}" not in text and f"from {folder}" not in text


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_every_exercise_has_a_hint_and_a_solution(path):
    found = exercises(path)
    assert [exercise.number for exercise in found] == list(range(1, len(found) + 1))
    assert len(found) >= 3
    for exercise in found:
        assert exercise.code or "```sh\n" in exercise.solution
        for code in exercise.code:
            compile(code, f"{path.name}, solution {exercise.number}", "exec")
    # None is left in a list, as exercises without solutions would be.
    last = next(cell for cell in cells(path, "markdown") if "## Try" in cell)
    assert not re.search(r"^\d+\. ", last, re.M)


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_and_its_solutions_run(path, tmp_path, monkeypatch):
    nbclient = pytest.importorskip("nbclient", reason="pip install '.[notebooks]'")
    nbformat = pytest.importorskip("nbformat", reason="pip install '.[notebooks]'")
    pytest.importorskip("ipykernel", reason="pip install '.[notebooks]'")
    pytest.importorskip("pandas", reason="pip install '.[notebooks]'")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    notebook = nbformat.read(path, as_version=4)
    new = nbformat.v4.new_code_cell
    solutions = [code for exercise in exercises(path) for code in exercise.code]
    for cell in notebook.cells:
        cell.source = re.sub(*FEWER_DRONES, cell.source)
    notebook.cells.insert(0, new(NOTE.replace("PICTURES", PICTURES.get(path.stem, "options"))))
    notebook.cells.append(new(STAND_IN))
    notebook.cells += [new(briefly(code)) for code in solutions if not EXPENSIVE.search(code)]
    resources = {"metadata": {"path": str(tmp_path)}}
    # Raises with the cell and its traceback if one fails.
    nbclient.NotebookClient(notebook, timeout=600, resources=resources).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    assert any("image/png" in output.get("data", {}) for output in outputs)
