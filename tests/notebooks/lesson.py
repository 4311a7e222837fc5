"""Lessons as their tests see them: cells, exercises, and the solutions' code."""

import json
import re
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted(
    (ROOT / "notebooks").glob("*.ipynb"), key=lambda path: int(path.name.partition("_")[0])
)
_EXERCISE = re.compile(
    r"\*\*(?P<number>\d+)\.\*\* .+?\n\n"
    r"<details>\n<summary>Hint</summary>\n\n(?P<hint>.+?)\n\n</details>\n"
    r"<details>\n<summary>Solution</summary>\n\n(?P<solution>.+?)\n\n</details>",
    re.S,
)


class Exercise(NamedTuple):
    """An exercise with a hint and a solution that a reader opens.

    Attributes:
        number: in its lesson, from 1.
        hint, solution: Markdown.
    """

    number: int
    hint: str
    solution: str

    @classmethod
    def of(cls, text: str) -> "Exercise | None":
        """Returns the exercise that a cell of text is, None if it is none.

        Raises:
            AssertionError: if it has no hint or no solution.
        """
        if not re.match(r"\*\*\d+\.", text):
            return None
        match = _EXERCISE.fullmatch(text)
        assert match, f"This exercise lacks a hint or a solution:\n{text}"
        return cls(int(match["number"]), match["hint"], match["solution"])

    @property
    def code(self) -> list[str]:
        """The Python of the solution, block by block."""
        return re.findall(r"^```python\n(.+?)^```$", self.solution, re.S | re.M)


def cells(path: Path, kind: str) -> list[str]:
    """Returns the sources of a notebook's cells of a kind: "code" or "markdown"."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    return ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == kind]


def exercises(path: Path) -> list[Exercise]:
    """Returns the exercises of a notebook, each in a cell of its own.

    Raises:
        AssertionError: if one of them has no hint or no solution.
    """
    found = map(Exercise.of, cells(path, "markdown"))
    return [exercise for exercise in found if exercise is not None]
