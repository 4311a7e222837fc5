"""The comparison with other simulators, with peers that are shell scripts."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.scenario import Scenario
from benchmarks.peers import __main__ as peers
from benchmarks.peers import circle, fly_airrace
from benchmarks.peers import environments as env

ROW = {
    "controller": "PID",
    "besides": "wind",
    "position_hz": 100,
    "attitude_hz": 500,
    "physics_hz": 240,
    "integrator": "Euler",
    "simulated_s": 10.0,
    "rms_m": 0.05,
}


def result(simulator, *cpu_s, **more):
    return {
        "simulator": simulator,
        "rows": [ROW | {"cpu_s": s, "wall_s": 2.0 * s} for s in cpu_s],
        **more,
    }


def executable(path, script):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("#!/bin/sh\n" + script)
    path.chmod(0o755)
    return path


def installed(folder, name, script):
    executable(folder / name / "bin" / "python", script)
    (folder / name / "airrace-requirement").write_text(f"{name} == 1.0")


@pytest.fixture
def names(monkeypatch):
    """Makes these the peers, with a version 1.0, and airrace a shell script."""

    def these(*names, ours):
        monkeypatch.setattr(env, "requirements", lambda: {n: f"{n} == 1.0" for n in names})
        monkeypatch.setattr(peers.sys, "executable", str(ours))

    return these


@given(time=st.floats(0.0, 20.0))
def test_derivatives_on_the_circle(time):
    h = 1e-4
    change = (circle.derivatives(time + h) - circle.derivatives(time - h)) / (2.0 * h)
    assert np.allclose(change[:-1], circle.derivatives(time)[1:], atol=1e-5)
    assert math.isclose(np.hypot(*circle.derivatives(time)[0, :2]), circle.RADIUS)


def test_laps_that_warm_up_do_not_count():
    flown = []

    def fly(start, end):
        flown.append((start, end))
        times = np.linspace(start, end, 5)
        aside = 1.0 if len(flown) <= circle.WARM_UP else 0.1
        return times, [circle.derivatives(t)[0] + [0.0, 0.0, aside] for t in times]

    row = circle.timed(fly, laps=3, controller="PID")
    assert np.allclose(np.diff(flown), circle.PERIOD)
    assert [start for start, _ in flown[1:]] == [end for _, end in flown[:-1]]
    assert len(flown) == circle.WARM_UP + 3 and row["simulated_s"] == 3 * circle.PERIOD
    assert row["rms_m"] == pytest.approx(0.1) and row["controller"] == "PID"


def test_ours_flies_the_circle(monkeypatch):
    monkeypatch.setattr(circle, "WARM_UP", 0)
    scenario = Scenario()
    row = circle.timed(fly_airrace.flight(scenario), laps=1)
    assert row["rms_m"] < 0.03
    assert scenario.controller.rate == fly_airrace.RATES[-1]


def test_medians_and_comparison():
    runs = [result("airrace, Drake", s, 2.0 * s) for s in (1.0, 4.0, 2.0)]
    for run in runs:
        run["rows"][0]["attitude_hz"] = 100
    rows = [*peers.medians(runs), *peers.medians([result("slow 1.0", 20.0)])]
    assert [row["x_cpu"] for row in rows] == [5.0, 2.5, 0.5]
    assert [row["x_wall"] for row in rows] == [2.5, 1.25, 0.25]
    assert rows[0]["x_cpu_range"] == [2.5, 10.0]
    peers.compare(rows)
    assert [row["ours"] for row in rows] == [None, None, 5.0]


def test_table_goes_on_without_a_peer(names, tmp_path, capsys):
    ours = result("airrace, Drake", 1.0, shares={"Referee": 0.25, "RotorBank": 0.75})
    script = executable(tmp_path / "ours", f"echo warning; echo '{json.dumps(ours)}'\n")
    names("good", "broken", "missing", ours=script)
    installed(tmp_path, "good", f"echo '{json.dumps(result('good 1.0', 4.0))}'\n")
    installed(tmp_path, "broken", "echo 'ImportError: no wings' >&2; exit 1\n")
    file = tmp_path / "numbers.json"
    options = ["--runs", "2", "--folder", str(tmp_path), "--json", str(file)]
    assert peers.main(options) == 1
    text = capsys.readouterr().out
    assert "4 times" in text and "RotorBank 75%, Referee 25%" in text
    assert "broken: ImportError: no wings." in text
    assert f"missing: missing == 1.0 is not in {tmp_path}; add --install." in text
    numbers = json.loads(file.read_text())
    assert [row["simulator"] for row in numbers["rows"]] == ["airrace, Drake", "good 1.0"]
    assert {name: len(runs) for name, runs in numbers["flights"].items()} == {
        "airrace": 2,
        "good": 2,
    }


def test_what_cannot_be_installed_is_said(names, tmp_path):
    pip = "echo warning >&2; echo 'ERROR: No matching distribution found for rare' >&2; exit 1"
    names(
        "rare",
        ours=executable(
            tmp_path / "ours",
            f'mkdir -p "$4/bin"; printf "#!/bin/sh\\n{pip}\\n" > "$4/bin/python"\n'
            'chmod +x "$4/bin/python"\n',
        ),
    )
    with pytest.raises(env.PeerError, match="^No matching distribution found for rare$"):
        env.install(tmp_path, "rare", "rare == 1.0")
    with pytest.raises(env.PeerError, match="--install"):
        env.python_of(tmp_path, "rare", "rare == 1.0")


def test_another_version_is_installed_anew(tmp_path):
    installed(tmp_path, "good", "exit 0\n")
    assert env.python_of(tmp_path, "good", "good == 1.0").is_file()
    with pytest.raises(env.PeerError):
        env.python_of(tmp_path, "good", "good == 2.0")


def test_no_result_is_an_error(tmp_path):
    with pytest.raises(env.PeerError, match="fly_it printed no result"):
        env.fly(executable(tmp_path / "silent", "exit 0\n"), "fly_it")
    with pytest.raises(env.PeerError, match="cannot be run"):
        env.fly(tmp_path / "nobody", "fly_it")


def test_every_peer_has_a_flight():
    flights = {path.stem for path in (env.ROOT / "benchmarks" / "peers").glob("fly_*.py")}
    assert flights == {f"fly_{name}" for name in (*env.requirements(), peers.OURS)}
