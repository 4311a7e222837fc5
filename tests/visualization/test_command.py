import json
import re

import pytest

from airrace.analysis import load_run
from airrace.commands.app import main as command
from airrace.common.errors import UserError
from airrace.visualization.ghosts import COLORS, make_ghosts, replay_page
from tests.worlds.made_up_run import FIRST, LAP, make_run


def main(words):
    """Calls `airrace replay`; returns its exit code."""
    return command(["replay", *words])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    make_run(folder / "one", laps=1)
    make_run(folder / "two", laps=2, drone="StarOne")
    make_run(folder / "silent", laps=1, recorded=False)
    return folder


@pytest.fixture(scope="module")
def runs(folder):
    return [load_run(folder / name) for name in ("one", "two")]


@pytest.mark.parametrize(
    "align, lap, start", [("start", 1, 0.0), ("lap", 1, FIRST), ("lap", 2, FIRST + LAP)]
)
def test_ghosts_begin_together(runs, align, lap, start):
    for ghost in make_ghosts(runs[lap - 1 :], align, lap):  # "one" has no second lap
        assert ghost.start == pytest.approx(start)


@pytest.mark.slow
def test_all_of_them_are_on_the_page(runs):
    page = replay_page(make_ghosts(runs[::-1], "lap"))
    config, record = (
        json.loads(re.search(rf'id="race-{name}">(.*?)</script>', page)[1])
        for name in ("config", "record")
    )
    assert [each["lap"] for each in record["crossings"]] == [1] * 10 + [2] * 10 + [3]
    assert len(config["ghosts"][0]["record"]["crossings"]) == 11
    assert config["ghosts"][0]["shift"] == 0.0 and config["begin"] == FIRST
    assert config["name"]["text"] == "two, best lap 5.00 s"
    (ghost,) = config["ghosts"]
    assert ghost["name"] == "one, best lap 5.00 s" and tuple(ghost["color"]) == COLORS["orange"]
    assert (config["body"], ghost["body"]) == tuple(
        f"drake/visualizer/run_{i}/body" for i in (0, 1)
    )
    assert len(page) < 30e6


def test_a_page_that_opens_offline(folder, tmp_path, capsys):
    page = tmp_path / "replay.html"
    args = [str(folder / "one"), str(folder / "two"), "--align", "lap", "--html", str(page)]
    assert main(args) == 0
    assert "race-record" in page.read_text() and "report.html" not in page.read_text()
    out = capsys.readouterr().out.splitlines()
    assert out == [f"blue: {folder / 'one'}", f"orange: {folder / 'two'}", f"Replay: {page}"]


def test_a_page_links_to_the_report(folder, tmp_path, capsys):
    run = tmp_path / "run #1"
    make_run(run, laps=1)
    (run / "report.html").write_text("a report")
    assert main([str(run), "--html", str(tmp_path / "replay.html")]) == 0
    assert '[["report","run%20%231/report.html"]]' in (tmp_path / "replay.html").read_text()


@pytest.mark.parametrize(
    "args, words",
    [
        (["one", "none"], "none/race.json cannot be read"),
        (["silent"], "has no race.mcap; name a race that was recorded"),
        (["one", "--lap", "2"], "--lap needs --align lap"),
        (["two", "--align", "lap", "--lap", "9"], "two has no lap 9, only 2; choose --lap 1 to 2"),
        (["one", "two", "--align", "lap", "--lap", "2"], "one has no lap 2, only 1; choose --al"),
        (["one"] * 7, "at most 6 runs, not 7"),
    ],
)
def test_bad_input(folder, capsys, args, words):
    args = [str(folder / arg) if (folder / arg).exists() or arg == "none" else arg for arg in args]
    assert main([*args, "--html", "/none/a.html"]) == 2
    *before, sentence = capsys.readouterr().err.splitlines()
    assert before in ([], ["Reading what was recorded..."]) and words in sentence


def test_a_page_that_cannot_be_written(folder, capsys):
    assert main([str(folder / "one"), "--html", "/none/a.html"]) == 2
    assert "/none/a.html cannot be written" in capsys.readouterr().err


def test_runs_of_other_tracks(runs, tmp_path, hexagon):
    other = load_run(make_run(tmp_path / "other", track=hexagon))
    with pytest.raises(UserError, match="was flown on another track"):
        make_ghosts([runs[0], other])


def test_a_replay_is_served_to_the_proxies_that_are_named(folder, monkeypatch):
    served = []
    monkeypatch.setattr(
        "airrace.visualization.page_server.serve_page", lambda *args: served.append(args[-1])
    )
    origin = "https://hub.example.org"
    assert main([str(folder / "one"), "--allow_origin", "http://a", "--allow_origin", origin]) == 0
    assert served[0].may_ask("hub.example.org", origin) and served[0].may_ask("a", "http://a")
    assert not served[0].may_ask("b", None)
    assert main([str(folder / "one"), "--allow_origin", "hub.example.org"]) == 2
