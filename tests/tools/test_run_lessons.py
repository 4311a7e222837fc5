"""Lessons are run with their solutions in place, and what was run is kept."""

import sys

import pytest

from tests.notebooks.lesson import NOTEBOOKS, exercises

nbformat = pytest.importorskip("nbformat", reason="pip install '.[notebooks]'")
pytest.importorskip("nbclient", reason="pip install '.[notebooks]'")
pytest.importorskip("ipykernel", reason="pip install '.[notebooks]'")
from tools import run_lessons  # noqa: E402 - it imports them itself

EXERCISE = """**1.** How much is it?

<details>
<summary>Hint</summary>

Multiply.

</details>
<details>
<summary>Solution</summary>

```python
print(6 * factor)
```

</details>"""


def lesson(folder, *code):
    """Writes a lesson with an exercise, and code before it; returns its path."""
    cells = [nbformat.v4.new_code_cell(each) for each in code]
    notebook = nbformat.v4.new_notebook(cells=[*cells, nbformat.v4.new_markdown_cell(EXERCISE)])
    path = folder / "1_lesson.ipynb"
    nbformat.write(notebook, path)
    return path


def run(monkeypatch, path, *options):
    monkeypatch.setattr(run_lessons, "NOTEBOOKS", [path])
    monkeypatch.setattr(sys, "argv", ["run_lessons", *map(str, options)])
    run_lessons.main()


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_every_solution_is_in_a_cell_after_its_exercise(path):
    cells = run_lessons.with_solutions(path).cells
    code = [each for exercise in exercises(path) for each in exercise.code]
    assert len(cells) == len(nbformat.read(path, as_version=4).cells) + len(code)
    for each in code:
        (at,) = [i for i, cell in enumerate(cells) if cell.source == each]
        before = [cell for cell in cells[:at] if cell.cell_type == "markdown"]
        assert each in before[-1].source


def test_a_copy_with_outputs_is_written_and_the_lesson_stays(tmp_path, monkeypatch, capsys):
    path = lesson(tmp_path, "factor = 7")
    before = path.read_bytes()
    run(monkeypatch, path, "--output", tmp_path / "runs")
    written = tmp_path / "runs" / path.name
    assert capsys.readouterr().out == f"{written}\n"
    assert nbformat.read(written, as_version=4).cells[-1].outputs[0].text == "42\n"
    assert path.read_bytes() == before


def test_what_was_run_before_a_cell_failed_is_there(tmp_path, monkeypatch):
    path = lesson(tmp_path, "print('so far')", "factor")
    with pytest.raises(run_lessons.nbclient.exceptions.CellExecutionError, match="factor"):
        run(monkeypatch, path, "--output", tmp_path / "runs")
    written = nbformat.read(tmp_path / "runs" / path.name, as_version=4)
    assert written.cells[0].outputs[0].text == "so far\n"


def test_a_lesson_that_is_not_there_is_named(monkeypatch, capsys):
    with pytest.raises(SystemExit) as exit_:
        run(monkeypatch, NOTEBOOKS[0], 2)
    assert exit_.value.code == 2
    assert "there is no lesson 2; there are 1 to 1" in capsys.readouterr().err
