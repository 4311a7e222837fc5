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
