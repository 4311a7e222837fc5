"""Whatever is deleted from a race.json, or replaced, is named in one sentence."""

import copy
import json

import pytest

from airrace.analysis.report import write_report
from airrace.common.errors import UserError
from airrace.recording.race_json import read_race_json
from tests.worlds.made_up_run import make_run, race_json


def places(data, place=()):
    """Every key and index within plain data, as tuples."""
    items = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in items:
        yield (*place, key)
        if isinstance(value, (dict, list)):
            yield from places(value, (*place, key))


def changes(data, others=({},)):
    """Copies of plain data, each with one thing deleted or replaced."""
    for place in places(data):
        for other in ("deleted", *others):
            changed = copy.deepcopy(data)
            holder = changed
            for key in place[:-1]:
                holder = holder[key]
            if other == "deleted":
                del holder[place[-1]]
            else:
                holder[place[-1]] = other
            yield place, other, changed


def is_taken(path, data):
    path.write_text(json.dumps(data))
    try:
        read_race_json(path)
    except UserError as e:
        assert str(e).startswith(f"{path} is no race.json: ") and "name the folder" in str(e)
        return False
    return True


# What nobody reads, and an event of a list that may be shorter.
FREE = {
    "rotor_failures",
    "max_acceleration",
    "max_rotor_thrust",
    "seconds",
    "real_time_factor",
    0,
    1,
}
PLAN = ("laps", 0, "plan", "max_speed")


def test_each_field_that_readers_use_is_checked(tmp_path):
    path, whole = tmp_path / "race.json", race_json(1)
    assert is_taken(path, whole)
    for place, other, data in changes(whole):
        if other in ("deleted", {}) and place != PLAN and is_taken(path, data):
            assert place[-1] in FREE, place


@pytest.mark.parametrize(
    "change, words",
    [
        (lambda race: race["laps"][1].update(lap=7), "laps.1..lap is 7, expected 2"),
        (lambda race: race["laps"][1]["gate_times_s"].pop(), "laps.1..gate_times_s"),
        (lambda race: race["laps"][0]["gate_offsets_m"].clear(), "laps.0..gate_offsets_m"),
        (lambda race: race["laps"][0].update(time_s=0.1), "one after another"),
        (lambda race: race.update(best_lap_s=None), "best_lap_s does not fit 2 laps"),
        (lambda race: race["exploration"].pop("events"), "exploration.events is missing"),
    ],
)
def test_what_does_not_fit_together(tmp_path, change, words):
    race = race_json(2)
    change(race)
    (tmp_path / "race.json").write_text(json.dumps(race))
    with pytest.raises(UserError, match=words):
        read_race_json(tmp_path / "race.json")


@pytest.mark.repeats
def test_what_is_taken_has_a_report(tmp_path):
    folder = make_run(tmp_path / "run", laps=1, recorded=False)
    for _, _, race in changes(race_json(1), (None, "text", -1.5, [], True)):
        if is_taken(folder / "race.json", race):
            try:
                write_report(folder)
            except UserError:
                pass
