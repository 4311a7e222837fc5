"""What verify compares without flying: a digit that was changed anywhere is found."""

import hashlib
import json

import pytest

from airrace.common.errors import UserError
from airrace.league import proof
from airrace.league.season import make_legs
from airrace.league.season_files import ranking_of
from tests.league.seasons import SEASON, SECRET, forge, make_season, result

LAPS = {"a": [result((10.0,)), result((11.0,))], "b": [result((12.0,)), result((), "hit a pylon")]}


@pytest.fixture
def folder(tmp_path):
    make_season(tmp_path / "out", LAPS)
    return tmp_path / "out"


def doubts(folder):
    """All that is said about a season's folder, as text."""
    league = proof.read_league(folder / "league.json")
    legs = make_legs(SEASON, SECRET)
    entries, of_entries = proof.load_flown_entries(folder, league)
    found = [*proof.check_season(league, SEASON, SECRET), *of_entries]
    found += proof.check_flights(folder, league)
    found += proof.check_whole(league, SEASON, SECRET, legs, entries)
    return [f"{each.where}: {each.what}" for each in found]


def test_an_honest_season(folder):
    assert doubts(folder) == []
    proof.check_versions(proof.read_league(folder / "league.json"))


def test_a_forged_lap_time_in_league_json(folder):
    def forged(league):
        league["flights"][0]["mean_lap_s"] = 9.9

    forge(folder / "league.json", forged)
    assert doubts(folder) == [
        "race 1 of a: mean_lap_s is 9.9 in league.json, 10.0 in race.json",
        doubts(folder)[1],
    ]
    assert doubts(folder)[1].startswith("ranking: ranking[0].")


def test_a_forged_lap_time_in_both_files(folder):
    def lap(race):
        race["mean_lap_s"] = race["best_lap_s"] = race["laps"][0]["time_s"] = 9.9

    def line(league):
        league["flights"][0].update(mean_lap_s=9.9, best_lap_s=9.9)

    forge(folder / "races" / "a-1" / "race.json", lap)
    forge(folder / "league.json", line)
    assert "race 1 of a: its race.json has another hash than league.json says" in doubts(folder)


def test_with_the_hash_forged_too_only_flying_again_helps(folder):
    """So compare() looks at the race that was flown again."""
    forged = result((9.9,))

    def line(league):
        text = json.dumps(forged, sort_keys=True).encode()
        league["flights"][0].update(
            mean_lap_s=9.9, best_lap_s=9.9, sha256=hashlib.sha256(text).hexdigest()
        )
        names = ["a", "b"]
        league["ranking"] = ranking_of(names, league["flights"], league["settings"])

    forge(folder / "races" / "a-1" / "race.json", lambda race: race.update(forged))

    def rows(folder):
        path = folder / "flights.jsonl"
        first, *others = map(json.loads, path.read_text().splitlines())
        digest = hashlib.sha256(json.dumps(forged, sort_keys=True).encode()).hexdigest()
        lines = [first | {"result": forged, "sha256": digest}, *others]
        path.write_text("".join(json.dumps(each) + "\n" for each in lines))

    forge(folder / "league.json", line)
    rows(folder)
    assert doubts(folder) == []
    first = proof.read_league(folder / "league.json")["flights"][0]
    conduct = {"attempts": []}
    assert proof.compare(folder, first, {"result": forged, "conduct": conduct}) is None
    doubt = proof.compare(folder, first, {"result": LAPS["a"][0], "conduct": conduct})
    assert doubt.where == "race 1 of a" and doubt.what.startswith("flown again, ")
    assert "10.0" in doubt.what and "9.9" in doubt.what
    doubt = proof.compare(folder, first, {"result": forged, "conduct": {"attempts": ["read /"]}})
    assert doubt.what == "flown again, it tries other things that it must not"


def test_a_better_place(folder):
    forge(folder / "league.json", lambda league: league["ranking"].reverse())
    (doubt,) = doubts(folder)
    assert doubt.startswith("ranking: ranking[0].")


def test_other_entries_seeds_and_rules(folder):
    (folder / "entries" / "a" / "mine.py").write_text("# quicker\n")
    (folder / "entries" / "b" / "entry.yaml").unlink()
    found = doubts(folder)
    assert "entry a: its files are not those that were flown" in found
    assert any(each.startswith("entry b: There is no entry") for each in found)
    league = proof.read_league(folder / "league.json")
    (doubt,) = proof.check_season(league, SEASON, SECRET + "!")
    assert doubt.what == "the secret seed is not the one that was flown"
    league["settings"]["season_sha256"] = "0"
    league["legs"][1]["track_sha256"] = "0"
    (season,) = proof.check_season(league, SEASON, SECRET)
    assert season.what == "season.yaml is not the one that was flown"


def test_a_race_that_is_gone(folder):
    (folder / "races" / "b-2" / "race.json").unlink()
    (found,) = doubts(folder)
    assert found.startswith("race 2 of b: its race.json is missing or broken")


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"format": 2}', "\xff"])
def test_what_is_no_result(tmp_path, text):
    path = tmp_path / "league.json"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(UserError, match="league.json .*; name the league.json"):
        proof.read_league(path)
    with pytest.raises(UserError, match="cannot be read"):
        proof.read_league(tmp_path / "gone.json")


def test_other_versions(folder):
    league = proof.read_league(folder / "league.json")
    league["settings"]["versions"]["drake"] = "1.0"
    with pytest.raises(UserError, match="This computer has drake .* instead of 1.0"):
        proof.check_versions(league)


def test_which_races_are_flown_again(folder):
    flights = proof.read_league(folder / "league.json")["flights"]

    def chosen(*args):
        return [proof.describe(line) for line in proof.choose(flights, *args)]

    *best, drawn = chosen(None, None, False)
    assert best == ["race 1 of a", "race 1 of b"]  # the quickest
    assert drawn in ("race 2 of a", "race 2 of b")
    assert {chosen(None, None, False)[2] for _ in range(50)} == {"race 2 of a", "race 2 of b"}
    assert chosen("b", None, True) == ["race 1 of b", "race 2 of b"]
    assert chosen(None, 2, False) == ["race 2 of a", "race 2 of b"]
    with pytest.raises(UserError, match="has no such race"):
        chosen("c", None, False)
