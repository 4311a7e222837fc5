import base64

import cv2
import numpy as np
import pandas as pd
import pytest

from airrace.analysis import load_run
from airrace.analysis.gate_pictures import gate_pictures
from tests.worlds.made_up_run import GATES, make_run


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return load_run(make_run(tmp_path_factory.mktemp("runs") / "made_up", laps=1))


def test_a_picture_in_front_of_each_gate(run):
    pictures = gate_pictures(run)
    assert [picture.gate for picture in pictures] == list(range(1, GATES + 1))
    # Pictures are taken every 0.2 s, and the only marker was read at 1.0 s, of gate 2.
    assert [picture.gate for picture in pictures if picture.seen] == [2]
    assert all(0.0 < picture.before <= 0.2 + 1e-6 for picture in pictures if not picture.seen)
    kind, _, data = pictures[0].url.partition(",")
    assert kind == "data:image/jpeg;base64"
    picture = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert picture.shape == (180, 320) and abs(picture.mean() - 128) < 2


def test_one_in_which_the_gate_was_read_is_preferred(run, monkeypatch):
    """Gate 3 is crossed at 3.0 s; markers 8 to 11 are its own."""
    rows = pd.DataFrame({"time": [2.4, 2.6, 2.8], "marker": [8, 11, 12]})
    monkeypatch.setitem(run.tables, "detections", rows)
    third = gate_pictures(run)[2]
    assert third.seen and third.before == pytest.approx(0.4, abs=1e-6)


def test_no_pictures_without_a_recording_or_a_lap(tmp_path):
    assert gate_pictures(load_run(make_run(tmp_path / "a", recorded=False))) == []
    assert gate_pictures(load_run(make_run(tmp_path / "b", laps=0, finished=False))) == []
