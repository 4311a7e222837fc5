"""The tables of docs/measurements/ are on the pages, and say where they come from."""

import json
import re

import pytest

from tests.docs.pages import PAGES, ROOT

FOLDER = ROOT / "docs" / "measurements"
_USES = re.compile(r"\{airrace-reference\} measurement (\S+)")
USED = sorted({name for page in PAGES for name in _USES.findall(page.read_text("utf-8"))})


def read(name):
    return json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))


def test_every_measurement_is_on_a_page():
    assert USED == sorted(path.stem for path in FOLDER.glob("*.json"))


@pytest.mark.parametrize("name", USED)
def test_a_measurement_says_where_it_comes_from(name):
    written = read(name)
    assert written["command"].startswith("python -m benchmarks.")
    assert written["commit"] != "unknown" and not written["commit"].endswith("+")
    assert written["machine"] and re.fullmatch(r"\d{4}-\d\d-\d\d", written["date"])
    assert all(table["rows"] for table in written["tables"])


def test_the_readme_has_the_results_as_measured():
    (table,) = read("student_airrace")["tables"]
    measured = {row[0]: dict(zip(table["headings"], row, strict=True)) for row in table["rows"]}
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"(?m)^\| (\S+) \| ([\d.]+) s \| ([\d.]+) s \| (?:([\d.]+) s)? ?\|", readme)
    assert [row[0] for row in rows] == ["optimal", "3-D", "4-D", "6-D"]
    for name, *laps in rows:
        row = measured[name]
        columns = "mean lap (s)", "best lap (s)", "the original's mean lap (s)"
        flown, _, races = row["finished"].partition(" of ")
        assert flown == races
        assert laps == [row[column].strip("- ") for column in columns]
