import cv2
import numpy as np
import pytest
from matplotlib.patches import Circle

from airrace.track import load_track
from airrace.track.plot import draw_track, save_plot

TRACK = load_track("student-airrace")


def test_draws_what_there_is():
    axes = draw_track(TRACK).axes[0]
    feet = [patch.center for patch in axes.patches if isinstance(patch, Circle)]
    np.testing.assert_allclose(feet, TRACK.pylons()[:, :2])
    labels = {text.get_text() for text in axes.texts}
    assert {*map(str, range(1, 11)), "start"} <= labels
    assert axes.get_title() == "student-airrace: 10 gates, 382 m, counter-clockwise"


def test_writes_a_picture(tmp_path):
    save_plot(TRACK, tmp_path / "t.png")
    picture = cv2.imread(str(tmp_path / "t.png"))
    assert min(picture.shape[:2]) > 800
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 5


@pytest.mark.parametrize("name", ["t.svg", "t.PDF", "t.png"])
def test_the_same_track_is_the_same_file(name, tmp_path):
    files = [tmp_path / folder / name for folder in ("a", "b")]
    for file in files:
        file.parent.mkdir()
        save_plot(TRACK, file)
    assert files[0].read_bytes() == files[1].read_bytes()
