"""league.json and league.html of a season that nobody flew."""

import html.parser
import json

import pytest

from airrace.league.page import short_reason, write_page
from tests.league.seasons import make_season, result, row

CHEAT = "read /root/<script>alert(1)</script>"


@pytest.fixture(scope="module")
def season(tmp_path_factory):
    """Its folder, and what league.json holds."""
    folder = tmp_path_factory.mktemp("season") / "out"
    cheated = row("b", 1, result((12.0,)), missed_deadlines=3, longest_step_s=0.5)
    cheated["conduct"]["attempts"] = [CHEAT]
    league = make_season(
        folder,
        {"a": [result((10.0,)), result((11.0,))], "b": [cheated, result((), "hit pylon 1 & 2")]},
    )
    (folder / "races" / "a-1" / "race.html").write_text("a replay")
    return folder, league


class Text(html.parser.HTMLParser):
    """The text and the links of a page."""

    def __init__(self, page):
        super().__init__()
        self.words, self.links, self.tags = "", [], set()
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.links += [value for name, value in attrs if name in ("href", "src")]

    def handle_data(self, data):
        self.words += f" {data.strip()}"


def test_league_json(season):
    folder, league = season
    assert json.loads((folder / "league.json").read_text()) == league
    assert league["complete"] and [each["entry"] for each in league["ranking"]] == ["a", "b"]
    assert [(line["entry"], line["leg"]) for line in league["flights"]] == [
        ("a", 1),
        ("a", 2),
        ("b", 1),
        ("b", 2),
    ]
    assert "nobody can guess" not in (folder / "league.json").read_text()


def test_the_page_says_it_all_and_needs_no_network(season):
    folder, league = season
    duel = {"leg": 1, "link": "duels/1.html", "first": "a", "second": "b", "gap_s": 2.0}
    path = write_page(folder, league, [duel])
    page = Text(path.read_text())
    assert path.name == "league.html"
    for words in ("Spring <b>", "Team a", "Team b", "hit pylon 1 & 2", CHEAT, "10.00", "12.00"):
        assert words in page.words, words
    assert "races/a-1/race.html" in page.links and "duels/1.html" in page.links
    assert "races/a-2/race.html" not in page.links  # there is no such replay
    assert not [link for link in page.links if "//" in link]


def test_a_season_that_is_not_complete(season, tmp_path):
    _, league = season
    part = {**league, "complete": False, "flights": league["flights"][:1]}
    page = Text(write_page(tmp_path, part).read_text())
    assert "10.00" in page.words


def test_reasons_are_shortened():
    assert short_reason("the entry was stopped by an error: KeyError: 1") == "KeyError: 1"
    assert len(short_reason(100 * "x")) == 34
