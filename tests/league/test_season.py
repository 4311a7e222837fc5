"""Seasons: the table of what is wrong with them, and races that follow from the secret alone."""

import dataclasses as dc

import pytest

from airrace.common.errors import UserError
from airrace.league.season import (
    Season,
    load_season,
    make_legs,
    read_secret,
    season_digest,
    secret_digest,
)

SECRET = "nobody can guess this"
SEASON = Season(name="spring", tracks=2, levels=[0, 2], track="hexagon", seed_file="s.seed")


def written(folder, text):
    path = folder / "spring.yaml"
    path.write_text(text)
    return path


GOOD = "name: Spring\nseed_file: spring.seed\n"


def test_a_season(tmp_path):
    season = load_season(written(tmp_path, GOOD + "levels: [1, 3]\nlimits: {memory: 2}\n"))
    assert season.levels == [1, 3] and season.limits.memory == 2.0


@pytest.mark.parametrize(
    "text, words",
    [
        ("seed_file: a\n", "name must not be empty"),
        (GOOD + "levels: []\n", "at least one level"),
        (GOOD + "levels: [5]\n", "levels must be numbers from 0 to 4"),
        (GOOD + "levels: [2, 2]\n", "each level once"),
        (GOOD + "tracks: 0\n", "tracks must be from 1 to 1000"),
        (GOOD + "laps: 0\n", "laps must be from 1 to 1000"),
        (GOOD + "estimator: gps\n", "estimator must be truth or vio"),
        (GOOD + "drones: [Eagle]\n", "drones must be shipped ones"),
        ("name: A\n", "seed_file must name the file"),
        (GOOD + "rate_step: 0\n", "rate_step must be above 0"),
        (GOOD + "rate_step: .nan\n", "rate_step must be above 0"),
        (GOOD + "track: hexagon\ngates: 8\n", "gates is for generated tracks"),
        (GOOD + "gates: 2\n", "gates must be one of"),
        (GOOD + "limits: {memory: 0}\n", "limits.memory must be positive, not 0"),
        (GOOD + "limits: {step_cpu: .inf}\n", "limits.step_cpu must be positive"),
        (GOOD + "prize: 100\n", "does not fit its schema"),
        (GOOD + "scenario_text: '{wings: 2}'\n", "wings"),
    ],
)
def test_what_is_wrong_is_said_in_a_sentence(tmp_path, text, words):
    with pytest.raises(UserError, match=words) as caught:
        load_season(written(tmp_path, text))
    assert "\n" not in str(caught.value)


def test_no_season(tmp_path):
    with pytest.raises(UserError, match="There is no season .*: name its YAML file"):
        load_season(tmp_path / "gone.yaml")


def test_the_secret(tmp_path):
    path = written(tmp_path, GOOD)
    season = load_season(path)
    with pytest.raises(UserError, match="spring.seed cannot be read; make it"):
        read_secret(path, season)
    (tmp_path / "spring.seed").write_text("1234\n")
    with pytest.raises(UserError, match="at least 16 characters"):
        read_secret(path, season)
    (tmp_path / "spring.seed").write_text(f"{SECRET}\n")
    assert read_secret(path, season) == SECRET


def test_races_follow_from_the_secret():
    legs = make_legs(SEASON, SECRET)
    assert [leg.number for leg in legs] == [1, 2, 3, 4]
    assert [leg.level for leg in legs] == [0, 0, 2, 2]
    assert len({leg.seed for leg in legs}) == 4
    assert make_legs(SEASON, SECRET) == legs
    assert not {leg.seed for leg in legs} & {leg.seed for leg in make_legs(SEASON, SECRET + "!")}


@pytest.mark.slow
def test_generated_tracks():
    season = dc.replace(SEASON, track="", gates=8, levels=[1])
    first, second = make_legs(season, SECRET)
    assert first.gates == second.gates == 8 and first.track != second.track


def test_digests():
    assert season_digest(SEASON) == season_digest(dc.replace(SEASON))
    assert season_digest(SEASON) != season_digest(dc.replace(SEASON, laps=4))
    assert secret_digest(SECRET) != secret_digest(SECRET + " ")
    assert SECRET not in secret_digest(SECRET)
