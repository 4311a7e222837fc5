"""The notebooks run from top to bottom, and are committed without outputs."""

import json
import re
import subprocess
import sys
import tempfile
import types

import pytest

from airrace.betaflight.firmware import find_firmware
from airrace.commands import python_race
from airrace.common.errors import UserError
from tests.notebooks.lesson import NOTEBOOKS, ROOT, cells, exercises

# To save time, lessons' races here have half of the usual pictures, or none and a given map.
FEWER = {"camera": {"fps": 15}}
NONE = {"map": "track", "camera": {"renderer": "none"}}
RACES = {
    "1_first_race": FEWER,
    "5_your_own_box": FEWER,
    "6_compare_and_evaluate": NONE,
    "10_a_policy_that_learns": NONE,
}
# What is learned is learned by half of the drones.
FEWER_DRONES = "DRONES, SECONDS = 128", "DRONES, SECONDS = 64"
# Without --all, races are shorter still, and so is what else takes seconds; and all of it runs in
# this process, as a script would.
BRIEF_RACES = {
    **RACES,
    "1_first_race": NONE,
    "5_your_own_box": {**FEWER, "referee": {"time_limit": 6.0}},
    "11_tune_the_rate_loop": {"referee": {"time_limit": 1.0}},
}
BRIEF_CODE = {
    "2_dynamics_and_controller": [("seconds=8.0", "seconds=4.0")],
    "3_pixels_to_map": [("count=6", "count=2"), ("8.0, 60)", "8.0, 20)")],
    "6_compare_and_evaluate": [
        ("--tracks 2", "--tracks 1"),
        ("len(races) == 2", "len(races) == 1"),
    ],
    "7_where_am_i": [("range(8)", "range(3)"), ("FLIGHTS = 5", "FLIGHTS = 2")],
    "8_delay_in_the_loop": [
        ("(0.0, 0.02, 0.03, 0.04, 0.06)", "(0.0, 0.03, 0.06)"),
        ("seconds=6.0", "seconds=4.0"),
        ("times > 5.0", "times > 3.0"),
    ],
    "9_losing_a_rotor": [("seconds=8.0", "seconds=6.0")],
    "10_a_policy_that_learns": [
        ("DRONES, SECONDS = 128, 8.0", "DRONES, SECONDS = 32, 4.0"),
        ("iterations=60", "iterations=2"),
        ("iterations=30", "iterations=2"),
    ],
    "11_tune_the_rate_loop": [
        ("(22, 45, 90, 160)", "(45, 90)"),
        ("(0, 30, 60, 120)", "(0, 60)"),
        ('("shipped", "hardly filtered")', '("shipped",)'),
    ],
}
# What these say at their end of what they have shown needs all of the lesson.
ONLY_WHOLE = "5_your_own_box", "10_a_policy_that_learns", "11_tune_the_rate_loop"
FIRMWARE = "11_tune_the_rate_loop"  # takes what `airrace betaflight build` builds
# Before a lesson: notes what it flies, and lets its races be short.
NOTE = """
import dataclasses as _dc
import json as _json

from airrace.commands import python_race
from airrace.commands.race import AnyRaceOptions
from airrace.diagrams.race_command import race_scenario

_fly, _folders = python_race.fly_any, []

def _short(options):
    fields = _json.loads(options.scenario_text or "{}")
    for name, value in FIELDS.items():
        fields[name] = {**fields.get(name, {}), **value} if isinstance(value, dict) else value
    return _dc.replace(options, scenario_text=_json.dumps(fields))

def _note(options, quiet=False):
    result, folder = _fly(_short(options), quiet)
    _folders.append(folder)
    return result, folder

python_race.fly_any = _note
"""
_run = subprocess.run
# And an evaluation in a lesson is of races on a given map.
GIVEN = ["--workers", "1", "--scenario_text", "{map: track, camera: {renderer: none}}"]
EVALUATE = """
import subprocess

_run = subprocess.run

def _run_briefly(command, **options):
    return _run([*command, *GIVEN] if "evaluate" in command else command, **options)

subprocess.run = _run_briefly
"""
# Before its solutions: to fly their races would take minutes. Their options are checked, and the
# lesson's last race, or else a short one, is what they look at.
STAND_IN = """
_SHORT = AnyRaceOptions(
    track="hexagon", laps=1, map="track", renderer="none", meshcat=False, report=False, linger=0.0
)

def _stand_in(options, quiet=False):
    race_scenario(options)
    return {}, _folders[-1] if _folders else _note(_SHORT, quiet=True)[1]

python_race.fly_any = _stand_in
"""
EXPENSIVE = re.compile(r"\bevaluate\(")  # flies races in processes of their own
# Solutions learn for three iterations, and fly the first two of a series.
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


def note(path, races):
    """Returns the code before a lesson that makes its races short."""
    return NOTE.replace("FIELDS", repr(races.get(path.stem, {})))


def need_firmware(path):
    """Skips the lesson of Betaflight on a computer without it."""
    if path.stem == FIRMWARE:
        try:
            find_firmware()
        except UserError as e:
            pytest.skip(str(e))


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path, tmp_path, monkeypatch):
    pytest.importorskip("pandas", reason="pip install '.[notebooks]'")
    plt = pytest.importorskip("matplotlib.pyplot")
    need_firmware(path)
    code = cells(path, "code")
    for old, new in BRIEF_CODE.get(path.stem, ()):
        assert any(old in source for source in code), f"{path.name} has no {old}"
        code = [source.replace(old, new) for source in code]
    if path.stem in ONLY_WHOLE:
        assert code.pop().startswith("assert ")
    module = types.ModuleType("__main__")
    monkeypatch.setitem(sys.modules, "__main__", module)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(python_race, "fly_any", python_race.fly_any)  # is given back
    if path.stem == "6_compare_and_evaluate":
        monkeypatch.setattr(subprocess, "run", evaluate)
    for source in (note(path, BRIEF_RACES), *code):
        exec(compile(source, path.name, "exec"), vars(module))
    assert plt.get_fignums()
    plt.close("all")


def evaluate(command, **options):
    """Runs `airrace evaluate` on a given map."""
    return _run([*command, *GIVEN], **options)


@pytest.mark.repeats
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_and_its_solutions_run(path, tmp_path, monkeypatch):
    nbclient = pytest.importorskip("nbclient", reason="pip install '.[notebooks]'")
    nbformat = pytest.importorskip("nbformat", reason="pip install '.[notebooks]'")
    pytest.importorskip("ipykernel", reason="pip install '.[notebooks]'")
    pytest.importorskip("pandas", reason="pip install '.[notebooks]'")
    need_firmware(path)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    notebook = nbformat.read(path, as_version=4)
    for cell in notebook.cells:
        cell.source = cell.source.replace(*FEWER_DRONES)
    new = nbformat.v4.new_code_cell
    before = note(path, RACES) + EVALUATE.replace("GIVEN", repr(GIVEN))
    notebook.cells.insert(0, new(before))
    solutions = [code for exercise in exercises(path) for code in exercise.code]
    notebook.cells.append(new(STAND_IN))
    notebook.cells += [new(briefly(code)) for code in solutions if not EXPENSIVE.search(code)]
    resources = {"metadata": {"path": str(tmp_path)}}
    # Raises with the cell and its traceback if one fails.
    nbclient.NotebookClient(notebook, timeout=600, resources=resources).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    assert any("image/png" in output.get("data", {}) for output in outputs)
