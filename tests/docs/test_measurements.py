"""The tables of docs/measurements/ are on the pages, and say where they come from."""

import json
import re

import pytest

from tests.docs.pages import PAGES, ROOT

FOLDER = ROOT / "docs" / "measurements"
_USES = re.compile(r"airrace-reference: measurement (\S+)")
README = (ROOT / "README.md").read_text(encoding="utf-8")
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
    rows = re.findall(
        r"(?m)^\| (\S+|optimal, `--limits rotor`) \| ([\d.]+) s \| ([\d.]+) s \| (?:([\d.]+) s)? ?\| (\S+) .*\| ([\d.]+) cm \|$",
        README,
    )
    assert [row[0] for row in rows] == [
        *("optimal", "optimal, `--limits rotor`"),
        *("3-D", "4-D", "6-D"),
    ]
    for name, *laps, offset, map_error in rows:
        row = measured[name.replace("`--limits rotor`", "rotor")]
        columns = "mean lap (s)", "best lap (s)", "the original's mean lap (s)"
        flown, _, races = row["finished"].partition(" of ")
        assert flown == races
        assert laps == [row[column].strip("- ") for column in columns]
        assert offset == ("anywhere" if "optimal" in name else row["worst gate offset (m)"])
        assert map_error == f"{float(row['map, RMS error (cm)']):.1f}"


def test_the_readme_has_the_tracks_that_were_finished():
    (sentence,) = re.findall(r"it finished on (.+?)\. ", README)
    planner = {read(f"policies_level_{k}")["tables"][0]["rows"][0][1] for k in (1, 3)}
    assert len(planner) == 1
    level_4 = {row[0]: row[1] for row in read("generated")["tables"][0]["rows"]}["level 4"]
    assert sentence == f"{planner.pop()} at levels 1 and 3, on {level_4} at level 4"


def test_the_readme_has_the_laps_planned_as_the_original_planned_them():
    """On both maps: the true one, as docs/benchmarks.md has it with its command, and the noisy one."""
    true, noisy = re.findall(r"([\d.]+), ([\d.]+),? (?:and )?([\d.]+) s on", README)
    rows = read("original")["tables"][0]["rows"]
    assert list(noisy) == [row[2] for row in rows]
    benchmarks = (ROOT / "docs" / "benchmarks.md").read_text(encoding="utf-8")
    assert f"take {true[0]} s in 3-D, and {true[1]} s in 4-D and 6-D" in benchmarks
    assert f"it is {noisy[0]}, {noisy[1]} and {noisy[2]} s" in benchmarks
    original = (ROOT / "docs" / "original.md").read_text(encoding="utf-8")
    assert true[1] == true[2] and f"{true[0]}, {true[1]} and {true[2]} s" in original
