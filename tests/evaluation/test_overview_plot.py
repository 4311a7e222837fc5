import numpy as np
import pytest

from airrace.evaluation.overview_plot import beside, draw_picture, figures_of_merit, make_overview
from airrace.evaluation.summary import race_frame
from airrace.evaluation.tables import write_summary
from tests.evaluation.rows import SETTINGS, row
from tests.evaluation.test_tables import ROWS


def strips(figure):
    """The axes of the strips, in order."""
    return [axes for axes in figure.axes if axes.get_title(loc="left")]


def test_the_picture_shows_the_numbers(tmp_path):
    figure = make_overview(write_summary(tmp_path, SETTINGS, ROWS))
    exploration, mean_lap, *_ = strips(figure)
    finished, failed = exploration.collections[-2:]
    np.testing.assert_allclose(finished.get_offsets()[:, 0], [70.0])
    np.testing.assert_allclose(failed.get_offsets()[:, 0], [71.0])  # another one never explored
    assert exploration.get_title(loc="right") == "median 70.5, 2 races"
    rates, reasons = figure.axes[-2:]
    marks = [line.get_xdata()[0] for line in rates.lines if len(line.get_xdata()) == 1]
    assert np.round(marks, 1).tolist() == [33.3, 66.7, 33.3]
    assert [bar.get_width() for bar in reasons.patches] == [1, 1]


@pytest.mark.parametrize("races", [3, 300])
def test_every_race_has_a_mark_of_its_own(races):
    rng = np.random.default_rng(0)
    values = rng.normal(20.0, 1.0, races)
    heights = beside(values)
    assert np.abs(heights).max() <= 1.0
    # In parts of the strip's width and height, none is on top of another one.
    apart = np.abs(values[:, None] - values) / np.ptp(values) * 80 + 200 * np.abs(
        heights[:, None] - heights
    )
    assert np.all(apart[~np.eye(races, dtype=bool)] > 1e-3)


def test_equal_values_are_beside_each_other():
    assert len(set(beside(np.full(7, 3.0)).tolist())) == 7


def test_legends_are_not_on_the_data(tmp_path):
    rows = [row(seed, laps=(20.0 + seed / 7, 21.0)) for seed in range(30)]
    rows[3] = row(3, finished=False, laps=(), reason="hit the ground")
    figure = make_overview(write_summary(tmp_path, SETTINGS, rows))
    figure.canvas.draw()
    (legend,) = figure.legends
    assert {text.get_text() for text in legend.get_texts()} == {
        "finished",
        "did not finish",
        "median",
        "half of the races",
    }
    assert not any(axes.get_legend() for axes in figure.axes)
    box = legend.get_window_extent()
    assert not any(box.overlaps(axes.get_window_extent()) for axes in figure.axes)


def test_a_race_without_a_number_has_no_mark(tmp_path):
    races = race_frame(write_summary(tmp_path, SETTINGS, ROWS)["races"])
    merits = figures_of_merit(races)
    assert [int(values.notna().sum()) for values in merits.values()] == [2, 2, 2, 2, 2]


def test_a_picture_of_nothing(tmp_path):
    draw_picture(tmp_path, write_summary(tmp_path, SETTINGS, []))
    assert (tmp_path / "evaluation.png").read_bytes().startswith(b"\x89PNG")
