"""Runs the lessons with all of their solutions, so that what their texts say can be checked.

Tests do not fly the races of solutions, which take minutes. Here they are flown. Of each notebook a
copy is written with its outputs, in which every solution is run in a cell below its exercise.
"""

import argparse
import os
from pathlib import Path

import nbclient
import nbformat
from rich.console import Console
from rich.progress import Progress

from tests.notebooks.lesson import NOTEBOOKS, ROOT, Exercise


def with_solutions(path: Path) -> nbformat.NotebookNode:
    """Returns a notebook in which the code of each solution is a cell after it."""
    notebook = nbformat.read(path, as_version=4)
    cells = []
    for cell in notebook.cells:
        cells.append(cell)
        exercise = Exercise.of(cell.source) if cell.cell_type == "markdown" else None
        cells += [nbformat.v4.new_code_cell(code) for code in exercise.code] if exercise else []
    notebook.cells = cells
    return notebook


def main() -> None:
    """The command-line program."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    numbers = range(1, len(NOTEBOOKS) + 1)
    parser.add_argument("lessons", nargs="*", type=int, metavar="N", help="by default all")
    parser.add_argument("--output", type=Path, default=ROOT / "runs" / "lessons")
    args = parser.parse_args()
    if unknown := set(args.lessons).difference(numbers):
        parser.error(f"there is no lesson {min(unknown)}; there are 1 to {len(NOTEBOOKS)}")
    os.environ["PYTHONPATH"] = str(ROOT)
    args.output.mkdir(parents=True, exist_ok=True)
    with Progress(console=Console(stderr=True)) as progress:
        for number in progress.track(args.lessons or numbers):
            path = NOTEBOOKS[number - 1]
            notebook = with_solutions(path)
            resources = {"metadata": {"path": str(args.output)}}
            try:
                nbclient.NotebookClient(notebook, timeout=None, resources=resources).execute()
            finally:  # what was run before a cell failed is there to be read
                nbformat.write(notebook, args.output / path.name)
            print(args.output / path.name)


if __name__ == "__main__":
    main()
