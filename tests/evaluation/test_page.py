import dataclasses as dc
import re
import shlex

from airrace.evaluation.jobs import generated_track, given_track, make_jobs, settings
from airrace.evaluation.page import COLUMNS, race_commands, write_page
from airrace.evaluation.tables import write_summary
from airrace.scenario import Scenario, load_scenario, scenario_yaml
from airrace.scenario.options import resolve_scenario
from tests.evaluation.rows import SETTINGS, row
from tests.evaluation.test_tables import ROWS
from tests.worlds.command_line import parse


def page(folder, rows):
    return write_page(folder, write_summary(folder, SETTINGS, rows), rows).read_text()


def test_it_needs_nothing_else(tmp_path):
    text = page(tmp_path, ROWS)
    assert not re.findall(r"<(?:link|img|image|iframe)\b|<script [^>]", text)
    assert not re.findall(r'(?:src|href)="(?!#)', text)
    assert "var(--ink)" in text


def test_every_race_and_every_column_is_there(tmp_path):
    text = page(tmp_path, ROWS)
    rows = re.findall(r"<tr(?! *>\n<th).*?</tr>", text.partition("<tbody>")[2], re.S)
    assert len(rows) == len(ROWS)
    assert all(row.count("<td>") == len(COLUMNS) + 1 for row in rows)
    heads = re.findall(r'<button type="button"\s+title="([^"]+)"', text)
    assert len(heads) == len(COLUMNS) + 1 and all(len(head) > 30 for head in heads)
    assert "<td>25.00</td>" not in rows[0] and "<td>20.50</td>" in rows[0]
    assert rows[2].count("<td>–</td>") == 4  # no lap, no map, not explored


def test_what_failed_is_linked_and_told(tmp_path):
    rows = [*ROWS[:2], {**ROWS[2], "stderr": "Traceback <b>"}]
    text = page(tmp_path, rows)
    links = set(re.findall(r'href="#(race-\d+)"', text))
    assert links == set(re.findall(r'<details id="(.*?)"', text)) == {"race-1", "race-2"}
    assert "Traceback &lt;b&gt;" in text and "a | b [red]$x_1$" in text
    # The reasons lead to the races that ended for them.
    reasons = re.findall(r'<a href="#races" data-reason="(.*?)"', text)
    assert sorted(reasons) == sorted(re.findall(r'<tr class="failed" data-reason="(.*?)"', text))


def test_no_race_yet_and_none_that_failed(tmp_path):
    assert "No race has ended yet." in page(tmp_path, [])
    assert "What failed" not in page(tmp_path, [row(0)])


def test_the_commands_fly_the_very_race_again(tmp_path):
    level = load_scenario(filename="levels", scenario_name="Level3")
    scenario = dc.replace(level, laps=2, trajectory="4")
    job = make_jobs(scenario, [1003], [generated_track(1003)])[0]
    make_track, fly = race_commands(
        1003, settings([job], track="generated tracks", scenario_name="Level3")
    )
    assert make_track == "airrace track --seed 1003 > track-1003.yaml"
    words = shlex.split(fly)[2:]
    again = resolve_scenario(parse("race", words))
    assert again.track == "track-1003.yaml"
    assert scenario_yaml(dc.replace(again, track=Scenario().track)) == job.scenario


def test_the_commands_name_a_track_that_was_given():
    job = make_jobs(Scenario(), [7], [given_track("hexagon")])[0]
    (fly,) = race_commands(7, settings([job], track="the track hexagon", scenario_name="x"))
    assert fly == "airrace race --track hexagon --seed 7"
