import re
import time
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from airrace.analysis import load_run
from airrace.analysis.figures_laps import states, time_lost
from airrace.analysis.figures_signals import map_by_lap, rotor_usage
from airrace.analysis.report import make_report, write_report
from airrace.commands.app import main as command
from airrace.common.errors import UserError
from tests.worlds.made_up_run import FIRST, GATES, LAP, MAP_ERROR, make_run


def main(words):
    """Calls `airrace report`; returns its exit code."""
    return command(["report", *words])


SECTIONS = [
    "Laps",
    "The track from above",
    "The planned laps",
    "Where time was lost",
    "Gates",
    "The map",
    "Tracking",
    "Rotors",
    "What the explorer did",
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return make_run(tmp_path_factory.mktemp("runs") / "made_up", laps=3)


def headings(text):
    return re.findall("<h2>(.*?)</h2>", text)


def check_page(text):
    """It needs nothing else, and every picture is well-formed, vector, and described."""
    assert text.startswith("<!doctype html>") and text.rstrip().endswith("</html>")
    assert not re.findall(r"<(?:script|link|img|image|iframe)\b", text)
    assert not re.findall(r'(?:src|href)="(?!#|data:)', text)
    pictures = re.findall(r'<div role="img" aria-label="(.*?)">\n(<svg.*?</svg>)', text, re.S)
    assert len(pictures) == text.count("<svg")
    for words, svg in pictures:
        assert len(words) > 30 and ET.fromstring(svg).tag.endswith("svg")


@pytest.mark.slow
def test_the_whole_report(folder, capsys):
    assert main([str(folder)]) == 0
    assert "report.html" in capsys.readouterr().out
    text = (folder / "report.html").read_text()
    check_page(text)
    assert headings(text) == SECTIONS
    assert text.count("<svg") == 8
    for word in ("40.60", "41.52", "41.21", "original, 6-D", "Finished.", "20.0 m/s"):
        assert word in text
    assert f"{LAP:.2f} s" in text  # the best lap
    # Below the table of laps, below the picture of the plans, and in its description.
    assert text.count("Laps 2 and 3 flew the plan of lap 1.") == 3
    assert re.findall(r"<td>(\d)</td><td>5.00</td>\n<td>4.80</td>\n<td>(\d)</td>", text) == [
        ("1", "1"),
        ("2", "1"),
        ("3", "1"),
    ]


@pytest.mark.slow
def test_the_same_run_gives_the_same_report_soon(folder):
    text = make_report(load_run(folder))
    start = time.process_time()
    assert make_report(load_run(folder)) == text
    assert time.process_time() - start < 3.0


def test_time_lost_counts_from_where_the_plan_is_in_force(folder):
    run = load_run(folder)
    lost = time_lost(run)
    assert list(lost) == [1, 2, 3]
    np.testing.assert_allclose(lost[1], np.linspace(0.0, 0.2, GATES + 1), atol=1e-9)
    # An entry that ends behind gate 3.
    run.plans["entry_duration"] = 1.0 + 2.5 * LAP / GATES
    late = time_lost(run)[1]
    assert np.isnan(late[:3]).all()
    np.testing.assert_allclose(late[3:], 0.02 * np.arange(GATES - 2), atol=1e-9)


def test_the_numbers_behind_the_pictures(folder):
    run = load_run(folder)
    errors = map_by_lap(run)
    assert list(errors) == [0, 1, 2, 3] and list(errors.index) == list(range(40))
    assert errors.loc[0, 3] == pytest.approx(MAP_ERROR, abs=1e-4)
    for share in rotor_usage(run):
        np.testing.assert_allclose(share, 1.6 / 8.5, rtol=1e-6)
    assert states(run) == [("CALIBRATE", 0.0, 0.5), ("TAKE_OFF", 0.5, FIRST)]


@pytest.mark.parametrize("field", [{"limits": "rotor"}, {"track": "hexagon"}])
def test_the_original_system_is_no_comparison_for_other_races(tmp_path, field):
    run = load_run(make_run(tmp_path / "run", recorded=False))
    assert "original, 3-D" in make_report(run)
    run.result |= field
    assert "original, 3-D" not in make_report(run)


def test_a_race_that_did_not_finish(tmp_path):
    folder = make_run(tmp_path / "run", laps=0, finished=False)
    text = write_report(folder).read_text()
    check_page(text)
    assert "Did not finish: touched &lt;pylon_3_left&gt;." in text
    assert "Laps" not in headings(text) and "Tracking" in headings(text)


def test_a_race_that_was_not_recorded(tmp_path):
    text = write_report(make_run(tmp_path / "run", recorded=False)).read_text()
    check_page(text)
    assert "was not recorded (--record none)" in text
    assert headings(text) == ["Laps", "The track from above", "Gates", "What the explorer did"]


@pytest.mark.slow
def test_a_race_that_was_killed(tmp_path):
    text = write_report(make_run(tmp_path / "run", closed=False)).read_text()
    check_page(text)
    assert "The recording ends at 12.5 s" in text


def test_a_folder_without_a_race(tmp_path, capsys):
    with pytest.raises(UserError, match="race.json"):
        write_report(tmp_path)
    assert main([str(tmp_path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
