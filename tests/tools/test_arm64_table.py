import copy
import json

import pytest

from tools.arm64_table import agree, main, table

RACE = {
    "finished": True,
    "exploration": {
        "events": [
            {"time_s": 0.5, "state": "TAKE_OFF", "reason": "level"},
            {"time_s": 3.05, "state": "HOVER", "reason": "reached the hover height"},
        ]
    },
    "laps": [{"time_s": 9.5, "gate_offsets_m": [0.1, 1.25]}],
}


def changed(change):
    other = copy.deepcopy(RACE)
    change(other)
    return other


def test_equal_races():
    assert agree(RACE, RACE)
    assert table(RACE, RACE).splitlines() == [
        "| | x86-64 | 64-bit Arm | difference |",
        "|---|---|---|---|",
        "| TAKE_OFF: level | 0.50 s | 0.50 s | 0 |",
        "| HOVER: reached the hover height | 3.05 s | 3.05 s | 0 |",
        "| lap 1 | 9.500000000 s | 9.500000000 s | 0 |",
        "| lap 1, farthest from the middle of a gate | 1.250000 m | 1.250000 m | 0 |",
    ]


def test_rounding_is_shown_and_allowed():
    def change(race):
        race["laps"][0] = {"time_s": 9.50000003, "gate_offsets_m": [0.100002, 1.25]}

    other = changed(change)
    assert agree(RACE, other)
    assert "| lap 1 | 9.500000000 s | 9.500000030 s | 3.0e-08 s |" in table(RACE, other)
    assert table(RACE, other).endswith("| 1.250000 m | 1.250000 m | 2.0e-06 m |")


@pytest.mark.parametrize(
    "change, line",
    [
        (
            lambda race: race["exploration"]["events"][1].update(reason="lost"),
            "| event | HOVER: reached the hover height | HOVER: lost | not the same |",
        ),
        (
            lambda race: race["exploration"]["events"].pop(),
            "| event | HOVER: reached the hover height | - | not the same |",
        ),
        (
            lambda race: race["exploration"]["events"][1].update(time_s=3.1),
            "| HOVER: reached the hover height | 3.05 s | 3.10 s | 5.0e-02 s |",
        ),
        (lambda race: race["laps"].pop(), "| lap 1 | flown | - | not the same |"),
        (
            lambda race: race["laps"][0].update(time_s=9.50001),
            "| lap 1 | 9.500000000 s | 9.500010000 s | 1.0e-05 s |",
        ),
    ],
)
def test_other_races_do_not_agree(change, line):
    other = changed(change)
    assert line in table(RACE, other).splitlines()
    assert not agree(RACE, other)


def test_a_race_that_did_not_finish_agrees_with_nothing():
    assert not agree(changed(lambda race: race.update(finished=False)), RACE)


def test_the_program(tmp_path, capsys):
    for name, race in {"x86-64": RACE, "arm64": changed(lambda race: race["laps"].pop())}.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "race.json").write_text(json.dumps(race))
    folders = [str(tmp_path / name) for name in ("x86-64", "arm64")]
    assert main([folders[0], folders[0]]) == 0
    assert main(folders) == 1
    assert capsys.readouterr().out.count("| x86-64 |") == 2
