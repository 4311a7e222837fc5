"""The tables of docs/ and README.md are those that benchmarks wrote."""

import json
import re

import pytest

from benchmarks.documented import BENCHMARKS, FOLDER
from tests.docs.pages import PAGES, ROOT

_USES = re.compile(r"\{airrace-reference\} measurement (\S+)")
USED = sorted({name for page in PAGES for name in _USES.findall(page.read_text("utf-8"))})


def read(name):
    return json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))


def test_every_measurement_is_on_a_page():
    assert USED == sorted(BENCHMARKS) == sorted(path.stem for path in FOLDER.glob("*.json"))


@pytest.mark.parametrize("name", USED)
def test_a_measurement_says_where_it_comes_from(name):
    written = read(name)
    assert written["command"].startswith("python -m benchmarks.")
    assert written["commit"] != "unknown" and not written["commit"].endswith("+")
    assert written["machine"] and re.fullmatch(r"\d{4}-\d\d-\d\d", written["date"])
    assert all(table["rows"] for table in written["tables"])


def test_the_results_of_the_readme_are_measured():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    results = text[text.index("## Results") : text.index("## Lessons")]
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in results.splitlines()
        if line.startswith("|")
    ][2:]
    reference, *_ = read("races")["tables"]
    measured = {row[0]: dict(zip(reference["headings"], row)) for row in reference["rows"]}
    assert rows
    for name, mean, best, original, offset, error in rows:
        row = measured[name]
        assert mean == f"{row['mean lap (s)']} s" and best == f"{row['best lap (s)']} s"
        assert original in ("", f"{row["the original's mean lap (s)"]} s")
        assert offset in ("anywhere in it", f"{row['worst gate offset (m)']} m")
        assert error == f"{row['map, RMS error (cm)']} cm"
