"""Whatever is edited in a season's folder is found without a flight."""

import copy
import json
import shutil

import pytest

from airrace.league import folder_check
from airrace.league.league_json import league_digest, read_league
from airrace.league.season import make_legs
from airrace.league.season_files import make_league
from tests.league.seasons import SEASON, SECRET, make_season, result, row, seal

LEGS = make_legs(SEASON, SECRET)
LAPS = {
    "a": [result((10.0,)), row("a", 2, result((11.0,)), attempts=["read /etc/passwd"], steps=3)],
    "b": [result((12.0,)), result((), "hit a pylon")],
}


@pytest.fixture(scope="module")
def season(tmp_path_factory):
    folder = tmp_path_factory.mktemp("season") / "out"
    make_season(folder, LAPS)
    (folder / "league.html").write_text("a page")
    seal(folder)
    return folder


@pytest.fixture
def folder(season, tmp_path):
    return shutil.copytree(season, tmp_path / "out")


def doubts(folder, league=None):
    """All that is said about a season's folder, but for hashes that who edits it can forge."""
    league = league or read_league(folder / "league.json")
    entries, found = folder_check.load_flown_entries(folder, league)
    found += [
        *folder_check.check_season(league, SEASON, SECRET),
        *folder_check.check_flights(folder, league),
        *folder_check.check_whole(league, SEASON, SECRET, LEGS, entries),
    ]
    return [f"{each.where}: {each.what}" for each in found]


def hashes(folder, league=None):
    league = league or read_league(folder / "league.json")
    return [f"{d.where}: {d.what}" for d in folder_check.check_digests(folder, league)]


def test_an_honest_season(season):
    assert doubts(season) == [] and hashes(season) == []


def edits(data, place=()):
    """Every place within plain data, and the data with another value there, and without it."""
    for key in data if isinstance(data, dict) else range(len(data)):
        value = data[key]
        if isinstance(value, (dict, list)) and value:
            for inner, changed in edits(value, (*place, key)):
                other = copy.copy(data)
                other[key] = changed
                yield inner, other
        else:
            other = copy.copy(data)
            other[key] = OTHER.get(type(value), lambda v: "another")(value)
            yield (*place, key), other
        other = copy.copy(data)
        del other[key]
        yield (*place, key, "deleted"), other
    if isinstance(data, list) and data:
        yield (*place, "again"), [*data, data[0]]


OTHER = {
    bool: lambda value: not value,
    int: lambda value: value + 1,
    float: lambda value: value + 0.5,
    str: lambda value: value + "x",
    type(None): lambda value: "none",
}
# What only the hashes of league.json cover, see `airrace league verify --help`.
ONLY_HASHED = {("settings", "refused"), ("settings", "safe"), ("settings", "versions")}


def test_each_field_of_league_json_is_refused_when_it_is_edited(season):
    whole = read_league(season / "league.json")
    path, tried = season.parent / "edited.json", 0
    for place, league in edits(whole):
        tried += 1
        path.write_text(json.dumps(league))
        try:
            league = read_league(path)
        except folder_check.UserError:
            continue
        assert league_digest(league) != league["sha256"], place
        if place[:2] not in ONLY_HASHED and place[0] not in ("files", "sha256"):
            assert doubts(season, league) != [], place
    assert tried > 200


def forged(folder, change):
    """Edits league.json as somebody does who computes ranking and hashes anew."""
    league = read_league(folder / "league.json")
    change(league)
    made = make_league(league["settings"], LEGS, league["flights"])
    league |= {name: made[name] for name in ("ranking", "flights")}
    (folder / "league.json").write_text(json.dumps(league))
    seal(folder)
    assert hashes(folder) == []
    return doubts(folder)


FORGERIES = {
    "a race left out": lambda league: league["flights"].pop(3),
    "a rival's race repeated": lambda league: league["flights"].extend([league["flights"][2]] * 2),
    "an entry left out": lambda league: (
        league["settings"]["entries"].pop(1),
        league.update(flights=league["flights"][:2]),
    ),
    "other rules": lambda league: league["settings"]["season"].update(rate_step=0.01),
    "another team": lambda league: league["settings"]["entries"][0].update(team="B"),
    "conduct emptied": lambda league: league["flights"][1]["conduct"].update(attempts=[]),
    "races emptied": lambda league: league["legs"].clear(),
    "a race that there is not": lambda league: league["flights"].append(
        {**league["flights"][0], "leg": 3}
    ),
    "not complete": lambda league: league.update(complete=False),
}


@pytest.mark.parametrize("change", FORGERIES.values(), ids=FORGERIES)
def test_a_forgery_with_right_hashes(folder, change):
    assert forged(folder, change) != []


def test_files_that_are_edited_gone_or_new(folder):
    (folder / "league.html").write_text("forged")
    (folder / "new.html").write_text("new")
    (folder / "races" / "a-1" / "entry.log").unlink()
    assert hashes(folder) == [
        'file "league.html": it has another hash than league.json says',
        'file "new.html": it is none of the season\'s',
        'file "races/a-1/entry.log": it is gone',
    ]


def test_a_path_for_a_name(folder):
    league = read_league(folder / "league.json")
    league["flights"][0]["entry"] = "../../a"
    (folder / "league.json").write_text(json.dumps(league))
    with pytest.raises(folder_check.UserError, match="an entry's name is none"):
        read_league(folder / "league.json")
