"""evaluation.html as people use it."""

import pytest

from airrace.evaluation.page import write_page
from airrace.evaluation.tables import write_summary
from tests.evaluation.rows import SETTINGS, row
from tests.visualization.browser import CHROMIUM, Browser
from tests.visualization.layout import check_page

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium to look with")
ROWS = [
    row(0, laps=(30.0,)),
    row(1, laps=(100.0,)),
    row(2, finished=False, laps=(), reason="touched pylon_3_left", collisions=1),
    row(3, finished=False, laps=(9.0,), reason="hit the ground"),
]
SEEDS = "[...document.querySelectorAll('tbody tr:not([hidden])')].map(r => r.cells[0].textContent)"


@pytest.mark.slow
def test_races_are_sorted_filtered_and_linked(tmp_path):
    path = write_page(tmp_path, write_summary(tmp_path, SETTINGS, ROWS), ROWS)
    with Browser(1000, 700) as browser:
        browser.open(path.as_uri())

        def press(text):
            browser.evaluate(
                f"[...document.querySelectorAll('button, a')].find("
                f"e => e.textContent.trim() === '{text}').click()"
            )
            return browser.evaluate(SEEDS)

        assert browser.evaluate(SEEDS) == ["0", "1", "2", "3"]
        # As numbers; without one, last.
        assert press("mean lap (s)") == ["3", "0", "1", "2"]
        assert press("mean lap (s)") == ["1", "0", "3", "2"]
        assert press("seed") == ["0", "1", "2", "3"]
        assert press("touched a pylon") == ["2"]
        assert press("Show all") == ["0", "1", "2", "3"]
        press("touched pylon_3_left")
        browser.wait_for("document.getElementById('race-2').open")
        assert not browser.evaluate("document.getElementById('race-3').open")
        assert not browser.errors and browser.requests == [path.as_uri()]
        check_page(browser, path.as_uri())
