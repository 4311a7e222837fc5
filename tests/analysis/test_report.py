import json
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from airrace.analysis import load_run
from airrace.analysis.figure_style import add_tip, inline_svg, make_figure
from airrace.analysis.figures_estimator import error_statistics
from airrace.analysis.figures_explorer import states
from airrace.analysis.figures_signals import map_by_gate, map_by_lap, rotor_usage
from airrace.analysis.report import make_report, write_report
from airrace.commands.app import main as command
from airrace.common.colors import rgb
from airrace.common.errors import UserError
from tests.worlds.cases import first
from tests.worlds.made_up_run import FIRST, GATES, LAP, MAP_ERROR, make_run, race_json


def main(words):
    """Calls `airrace report`; returns its exit code."""
    return command(["report", *words])


SECTIONS = [
    "Laps",
    "The track from above",
    "The planned laps",
    "Along the lap",
    "Where time was lost",
    "Gates",
    "What the camera saw",
    "The map",
    "Tracking",
    "Rotors",
    "What the explorer did",
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return make_run(tmp_path_factory.mktemp("runs") / "made_up", laps=3)


@pytest.fixture(scope="module")
def text(folder):
    """Its report, by the command."""
    assert main([str(folder)]) == 0
    return (folder / "report.html").read_text()


def headings(text):
    return re.findall("<h2>(.*?)</h2>", text)


def check_page(text):
    """It needs nothing else, and every picture is well-formed, vector, and described."""
    assert text.startswith("<!doctype html>") and text.rstrip().endswith("</html>")
    assert not re.findall(r"<(?:script|link|image|iframe)\b", text)
    assert not re.findall(r'(?:src|href)="(?!#|data:)', text)
    pictures = re.findall(
        r'<div class="(?:desk|phone)" role="img" aria-label="(.*?)">\n(<svg.*?</svg>)', text, re.S
    )
    assert len(pictures) == text.count("<svg")
    for words, svg in pictures:
        assert len(words) > 30 and ET.fromstring(svg).tag.endswith("svg")
        assert_follows_the_theme(svg)


def assert_follows_the_theme(svg):
    """All that a picture draws in is a variable of the page, or can be seen on any sheet."""
    contrasts = [
        contrast
        for color in set(re.findall(r"(?:fill|stroke): (#\w{6})", svg))
        for contrast in (ratio(color, "#ffffff"), ratio(color, "#202327"))
    ]
    assert min(contrasts, default=9.0) > 1.85
    assert "fill: var(--ink)" in svg and "fill: var(--card)" in svg


def ratio(a, b):
    """The contrast of two colours, from 1 to 21, as WCAG 2.1 defines it."""

    def luminance(color):
        channels = np.array(rgb(color))
        linear = np.where(
            channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4
        )
        return linear @ [0.2126, 0.7152, 0.0722]

    dark, light = sorted([luminance(a), luminance(b)])
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.slow
def test_the_whole_report(text):
    check_page(text)
    assert headings(text) == SECTIONS
    assert text.count("<svg") == 2 * 9
    for word in ("40.60", "41.52", "41.21", "original, 6-D", "Finished.", "20.0 m/s"):
        assert word in text
    assert f"{LAP:.2f} s" in text  # the best lap
    # Below the table of laps, below the picture of the plans, and in its two descriptions.
    assert text.count("Laps 2 and 3 flew the plan of lap 1.") == 4
    row = r"<td>(\d)</td><td>5.00</td>\n<td>(best|0.00)</td>\n<td>4.80</td>\n<td>(–|0.30)</td>\n<td>(\d)</td>"
    assert re.findall(row, text) == [
        ("1", "best", "–", "1"),
        ("2", "0.00", "0.30", "1"),
        ("3", "0.00", "–", "1"),
    ]


@pytest.mark.slow
def test_every_column_and_number_is_explained(text):
    """On hover, and where the Tab key leads."""
    heads = re.findall(r"<th\b(.*?)>", text)
    facts = re.findall(r"<li\b(.*?)>", text)
    assert len(heads) == 8 + GATES and len(facts) == 8
    for attributes in heads + facts:
        assert re.search(r'title="[^"]{20,}"', attributes) and 'tabindex="0"' in attributes


def test_no_words_that_somebody_hovers_over_break_the_picture():
    figure = make_figure(3, 2)
    (line,) = figure.add_subplot().plot([0, 1])
    add_tip(line, 'lap 1 <"&">')
    titles = [e.text for e in ET.fromstring(inline_svg(figure, "x")).iter() if "title" in e.tag]
    assert titles == ['lap 1 <"&">']


@pytest.mark.slow
def test_the_same_run_gives_the_same_report(folder, text):
    assert make_report(load_run(folder)) == text


def test_the_numbers_behind_the_pictures(folder):
    run = load_run(folder)
    errors = map_by_lap(run)
    assert list(errors) == [0, 1, 2, 3] and list(errors.index) == list(range(40))
    assert errors.loc[0, 3] == pytest.approx(MAP_ERROR, abs=1e-4)
    by_gate = map_by_gate(run)
    assert list(by_gate.index) == list(range(1, GATES + 1))
    np.testing.assert_allclose(by_gate, MAP_ERROR, atol=1e-4)
    for share in rotor_usage(run):
        np.testing.assert_allclose(share, 1.6 / 8.5, rtol=1e-6)
    assert states(run) == [("CALIBRATE", 0.0, 0.5), ("TAKE_OFF", 0.5, FIRST)]


@pytest.mark.slow
@pytest.mark.parametrize("field", first([{"limits": "rotor"}, {"track": "hexagon"}]))
def test_the_original_system_is_no_comparison_for_other_races(tmp_path, field):
    run = load_run(make_run(tmp_path / "run", recorded=False))
    assert "original, 3-D" in make_report(run)
    run.result |= field
    assert "original, 3-D" not in make_report(run)


def test_what_plans_count_with_is_told_when_it_changes(tmp_path):
    run = load_run(make_run(tmp_path / "run", laps=3, recorded=False))
    assert "that plans count with" not in make_report(run)
    drones = [([1.0, 1.0], [0.0, 0.0]), ([0.95, 1.02], [0.1, 0.006]), ([0.95, 1.02], [0.1, 0.006])]
    for lap, (rotors, drag) in zip(run.result["laps"], drones):
        lap["plan"].update(rotor_factors=rotors, drag=drag, wind=[3.0, -0.5, 0.0])
    told = make_report(run).split("that plans count with</h2>")[1].split("</table>")[0]
    (row,) = re.findall("<tr><td>(.*?)</tr>", told, re.DOTALL)
    assert row.startswith("2<")
    assert all(text in row for text in ("95.0 102.0", "0.1000", "3.0 -0.5 0.0"))


@pytest.mark.slow
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
    assert headings(text) == [
        "Laps",
        "The track from above",
        "Where time was lost",
        "Gates",
        "What the explorer did",
    ]


def test_a_race_whose_log_is_missing(tmp_path, capsys):
    folder = make_run(tmp_path / "run", recorded=False)
    scenario = folder / "scenario.yaml"
    scenario.write_text(scenario.read_text().replace("content: none", "content: full"))
    text = write_report(folder).read_text()
    check_page(text)
    assert "race.mcap is missing: of this race, only what race.json says is left." in text
    assert "--record none" not in text and "recording ends" not in text
    assert "race.mcap is missing" in capsys.readouterr().err


def test_it_says_what_was_flown_when_and_with_what(tmp_path):
    folder = make_run(tmp_path / "run", recorded=False)
    race = race_json(2)
    race["wall"] |= {"date": "2026-11-29T14:57:03+00:00", "version": "1.2.3"}
    race["systems"] = {"geometric_controller": "my_team:<make>"}
    (folder / "race.json").write_text(json.dumps(race))
    text = write_report(folder).read_text()
    check_page(text)
    when = "2026-11-29 14:57 UTC, airrace 1.2.3"
    assert f"<title>Default on student-airrace, {when}</title>" in text
    assert "Your own systems: geometric_controller is my_team:&lt;make&gt;." in text


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


@pytest.mark.slow
def test_a_drone_that_finds_out_where_it_is_has_sections_of_its_own(tmp_path):
    """The run's errors are as large as the estimator says."""
    run = load_run(make_run(tmp_path / "run", laps=3, estimator="vio"))
    text = make_report(run)
    check_page(text)
    expected = ["Where the drone thought it was", "How sure of it the drone was"]
    assert [heading for heading in headings(text) if heading not in SECTIONS] == expected
    assert "NEES per dimension" in text
    figures = error_statistics(run)
    assert figures["nees"] == pytest.approx(1.0, abs=0.1)
    assert figures["gap"] == pytest.approx(1.0, abs=0.05)
    racing = run.estimator[run.estimator["time"] > 6.0]
    assert np.std(racing["position_error_x"]) == pytest.approx(0.03, rel=0.2)
    assert run.innovations["squared"].mean() == pytest.approx(8.0, rel=0.1)


def test_all_samples_of_the_imu_are_there_once(tmp_path):
    run = load_run(make_run(tmp_path / "run", estimator="vio"))
    assert np.allclose(np.diff(run.imu_samples["time"]), 0.002)
    assert not len(load_run(make_run(tmp_path / "truth")).imu_samples)
