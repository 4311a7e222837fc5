import json
import re

import pytest

from airrace.evaluation.overview_plot import draw_picture
from airrace.evaluation.page import write_page
from airrace.evaluation.tables import write_summary
from tests.evaluation.rows import SETTINGS, row

ROWS = [
    row(0),
    row(1, finished=False, laps=(30.0,), reason="touched pylon_3_left", collisions=1),
    row(2, finished=False, laps=(), explored=False, reason="stopped by an error: a | b [red]$x_1$"),
]


def test_incomplete(tmp_path):
    evaluation = write_summary(tmp_path, SETTINGS, ROWS)
    assert json.loads((tmp_path / "evaluation.json").read_text()) == evaluation
    assert not evaluation["complete"]
    text = (tmp_path / "evaluation.md").read_text()
    assert "Not complete: 3 of 4 races have ended." in text
    assert "Finished 1 of 3 races: 33.3 %, 95 % interval 6.1 to 79.2 %; explored 2" in text
    assert "| exploration (s) | 2 | 70.5 | 70.5 | 70.0 | 71.0 |" in text


def test_markdown_tables_are_whole(tmp_path):
    """Whatever an error says, every row has as many cells as its heading."""
    write_summary(tmp_path, SETTINGS, ROWS)
    for table in re.findall(r"(?:^\|.*\n)+", (tmp_path / "evaluation.md").read_text(), re.M):
        cells = {len(re.findall(r"(?<!\\)\|", line)) for line in table.splitlines()}
        assert len(cells) == 1


@pytest.mark.slow
def test_the_same_races_in_any_order_and_at_any_speed(tmp_path):
    files = []
    for name, seconds in (("a", 1.0), ("b", 2.0)):
        folder = tmp_path / name
        folder.mkdir()
        rows = [{**r, "wall": {"seconds": seconds}} for r in (*ROWS, row(3))]
        evaluation = write_summary(folder, SETTINGS, rows)
        assert evaluation["complete"]
        draw_picture(folder, evaluation)
        write_page(folder, evaluation, rows)
        files.append({path.name: path.read_bytes() for path in folder.iterdir()})
    assert files[0] == files[1] and len(files[0]) == 4
