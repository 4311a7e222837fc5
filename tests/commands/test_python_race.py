"""airrace.race(), as lessons call it."""

import pytest

import airrace

BRIEFLY = {"referee": {"time_limit": 0.3}}


def test_a_race_from_python(tmp_path, capsys):
    run = airrace.race(
        track="hexagon",
        trajectory=3,
        laps=1,
        fields={**BRIEFLY, "explorer": {"max_speed": 4.0}},
        output=str(tmp_path / "out"),
        quiet=True,
    )
    assert capsys.readouterr().out == ""
    assert run.folder == tmp_path / "out" and len(run.state) > 10
    assert run.scenario.explorer.max_speed == 4.0 and run.scenario.trajectory == "3"
    assert not run.result["finished"]
    assert not (run.folder / "race.html").exists() and not (run.folder / "report.html").exists()


def test_it_says_where_the_results_are(tmp_path, capsys):
    airrace.race(track="hexagon", fields=BRIEFLY, output=tmp_path / "out", record="none")
    assert f"Results: {tmp_path / 'out'}" in capsys.readouterr().out


@pytest.mark.parametrize(
    "options, words",
    [
        (dict(trak="hexagon"), "has no option 'trak'; do you mean 'track'?"),
        (dict(track="nope"), "There is no track named 'nope'"),
        (dict(laps=0), "laps must be at least 1, not 0"),
        (dict(trajectory=5), "trajectory"),
        (dict(level=9), "Level9"),
        (dict(fields={"wings": 2}), "wings"),
        (dict(fields=BRIEFLY, scenario_text="{}"), "leave one out"),
    ],
)
def test_bad_options(options, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(airrace.UserError, match=words):
        airrace.race(**options)
    assert not list(tmp_path.iterdir())
