import cv2
import numpy as np
import pytest
from matplotlib.patches import Circle

from airrace.track import load_track
from airrace.track.plot import draw_track, save_plot
from tests.worlds.pictures import count_colours

TRACK = load_track("student-airrace")


def test_draws_what_there_is():
    axes = draw_track(TRACK).axes[0]
    feet = [patch.center for patch in axes.patches if isinstance(patch, Circle)]
    np.testing.assert_allclose(feet, TRACK.pylons()[:, :2])
    labels = {text.get_text() for text in axes.texts}
    assert {*map(str, range(1, 11)), "start"} <= labels
    assert axes.get_title() == "student-airrace: 10 gates, 382 m, counter-clockwise"


def test_explains_its_stripes_beside_the_track():
    figure = draw_track(TRACK)
    figure.canvas.draw()
    (legend,) = figure.legends
    words = [text.get_text() for text in legend.get_texts()]
    assert "board on the front, even markers" in words and "board on the back, odd markers" in words
    drawn = {line.get_color() for line in figure.axes[0].lines}
    assert {line.get_color() for line in legend.get_lines()[1:3]} <= drawn
    assert not legend.get_window_extent().overlaps(figure.axes[0].get_window_extent())


def test_writes_a_picture(tmp_path):
    save_plot(TRACK, tmp_path / "t.png")
    picture = cv2.imread(str(tmp_path / "t.png"))
    assert min(picture.shape[:2]) > 800
    assert count_colours(picture) > 5


@pytest.mark.parametrize("name", ["t.svg", "t.PDF", "t.png"])
def test_the_same_track_is_the_same_file(name, tmp_path):
    files = [tmp_path / folder / name for folder in ("a", "b")]
    for file in files:
        file.parent.mkdir()
        save_plot(TRACK, file)
    assert files[0].read_bytes() == files[1].read_bytes()


def test_draws_a_course_and_its_heights():
    course = load_track("grand-prix")
    plan, side = draw_track(course).axes
    labels = {text.get_text() for text in plan.texts}
    assert {*map(str, range(1, 18)), "start"} <= labels
    assert {text.get_text() for text in side.texts} == set(map(str, range(1, 18)))
    assert plan.get_title() == "grand-prix: 17 gates, 199 m"
    frames = [line.get_xydata() for line in side.lines if len(line.get_xydata()) == 2]
    heights = [line.mean(0)[1] for line in frames]
    np.testing.assert_allclose(heights, [gate.position[2] for gate in course.gates], atol=1e-9)
    np.testing.assert_allclose([np.ptp(line, axis=0) for line in frames], [[0.0, 2.72]] * 17)


def test_writes_a_picture_of_a_course(tmp_path):
    save_plot(load_track("grand-prix"), tmp_path / "t.png")
    assert min(cv2.imread(str(tmp_path / "t.png")).shape[:2]) > 800
