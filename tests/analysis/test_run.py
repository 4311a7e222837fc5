import importlib.util

import numpy as np
import pandas as pd
import pytest

from airrace.analysis import load_run
from airrace.analysis.derived import _tracking
from airrace.commands.app import main as command
from airrace.common.errors import UserError
from airrace.common.resources import find_yaml
from airrace.recording.writer import RaceLog
from tests.worlds.made_up_run import (
    FIRST,
    GATES,
    LAP,
    MAP_ERROR,
    OFF,
    RADIUS,
    TURN_RATE,
    flight,
    make_run,
)


def main(words):
    """Calls `airrace tables`; returns its exit code."""
    return command(["tables", *words])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return make_run(tmp_path_factory.mktemp("runs") / "made_up")


@pytest.fixture(scope="module")
def run(folder):
    return load_run(folder)


def test_states_are_in_the_world_frame(run):
    for state in (run.state, run.estimate, run.filtered):
        row = state.iloc[150]
        p, v, q = flight(row.time)
        assert row.time == pytest.approx(3.0)
        np.testing.assert_allclose(row[["x", "y", "z"]].astype(float), p, atol=1e-5)
        np.testing.assert_allclose(row[["vx", "vy", "vz"]].astype(float), v, atol=1e-4)
        np.testing.assert_allclose(
            row[["wx", "wy", "wz"]].astype(float), [0, 0, TURN_RATE], atol=1e-6
        )
        assert row.speed == pytest.approx(RADIUS * TURN_RATE)
        assert (row.roll, row.pitch) == pytest.approx((0, 0), abs=1e-6)
        turn = TURN_RATE * (3.0 - FIRST) + np.pi / 2 - row.yaw
        assert np.cos(turn) == pytest.approx(1.0)


def test_laps_are_counted_from_gate_1(run):
    laps = run.state.groupby("lap").time.agg(["min", "max"])
    assert list(laps.index) == [0, 1, 2, 3]
    assert laps["min"][1] == pytest.approx(FIRST)
    assert laps["min"][3] == pytest.approx(FIRST + 2 * LAP, abs=0.021)
    np.testing.assert_allclose(run.lap_starts, FIRST + LAP * np.arange(3))
    assert run.laps.duration.tolist() == [LAP, LAP] and run.laps.plan.tolist() == [1, 1]
    assert len(run.crossings) == 2 * GATES + 1


def test_without_a_reference_there_is_no_tracking(run):
    """As in the loop, where the reference does not cross the link."""
    state = run.state.assign(yaw=0.0)
    assert len(_tracking(state, state[["x", "y", "z", "yaw"]].iloc[:0])) == 0


def test_tracking_is_the_distance_from_the_reference(run):
    np.testing.assert_allclose(run.tracking.distance, OFF, atol=2e-5)
    np.testing.assert_allclose(run.tracking.yaw, 0.0, atol=1e-5)
    assert run.reference[["ax", "ay", "az"]].iloc[0].tolist() == [1.0, 2.0, 3.0]
    at = np.abs(run.reference.time - 3.0).idxmin()
    np.testing.assert_allclose(
        run.reference.loc[at, ["vx", "vy", "vz"]].astype(float), flight(3.0)[1], atol=1e-4
    )


def test_rotors_are_tidy(run):
    assert run.imu.time.min() == pytest.approx(0.019)  # at the start, there is no sample yet
    assert set(run.imu.wz[:50]) == {round(TURN_RATE, 6)} and set(run.imu.fz[:50]) == {9.81}
    assert run.imu[["wx", "fx"]][200:].isna().all(axis=None)
    assert sorted(run.rotors.rotor.unique()) == [1, 2, 3, 4]
    assert set(run.rotors.speed) == {40.0} and set(run.rotors.command) == {50.0}
    assert run.rotors.thrust.iloc[0] == pytest.approx(1.6)


def test_the_map_has_its_errors(run):
    assert len(run.map) == 3 * 40
    np.testing.assert_allclose(run.map.error, MAP_ERROR, atol=1e-4)
    assert set(run.map.gate) == set(range(1, 11))


def test_the_rest(run):
    (detection,) = run.detections.itertuples()
    assert (detection.marker, detection.range, detection.received) == (5, 5.0, 1.04)
    assert run.refused.reason.tolist() == ["image too dark"]
    assert run.plans.lap.tolist() == [1] and np.isnan(run.plans.solve_time[0])
    assert run.plan_gates.gate.tolist() == [*range(1, 11), 1]
    assert run.plan_samples.part.tolist() == ["entry"] * 2 + ["circuit"] * 2
    assert run.events[["name", "message"]].iloc[1].tolist() == ["TAKE_OFF", "level: taking off"]
    assert run.complete and run.recorded and "2 laps" in repr(run)
    assert set(run.tables) <= set(dir(run))
    with pytest.raises(AttributeError, match="no 'nothing'; its tables are: state"):
        run.nothing


@pytest.mark.parametrize("format, read", [("csv", pd.read_csv), ("parquet", pd.read_parquet)])
def test_export_and_back(run, folder, tmp_path, capsys, format, read):
    assert main([str(folder), "--export", str(tmp_path / "out"), "--format", format]) == 0
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        f"{name}.{format}" for name in run.tables
    }
    for name in ("state", "map", "events", "laps"):
        pd.testing.assert_frame_equal(
            read(tmp_path / "out" / f"{name}.{format}"), run.tables[name], check_dtype=False
        )
    assert "tables" in capsys.readouterr().out


def test_without_export_it_lists_the_tables(folder, capsys):
    assert main([str(folder)]) == 0
    out = capsys.readouterr().out
    assert "tracking" in out and "plan_samples" in out


def test_a_run_without_a_recording(tmp_path):
    run = load_run(make_run(tmp_path / "run", recorded=False) / "race.json")
    assert not run.recorded and not run.complete
    assert len(run.state) == len(run.rotors) == 0 and len(run.laps) == 2
    with pytest.raises(UserError, match="race.mcap cannot be read .No such file"):
        next(run.images())


def test_a_run_that_was_killed(tmp_path):
    run = load_run(make_run(tmp_path / "run", closed=False))
    assert run.recorded and not run.complete
    assert run.state.time.max() > FIRST + 2 * LAP


def test_what_was_raced_is_in_the_log(tmp_path):
    """Whatever happened to the track's file since."""
    folder = make_run(tmp_path / "run", recorded=False)
    text = find_yaml("tracks", "student-airrace").read_text().replace("student-airrace", "gone")
    (tmp_path / "gone.yaml").write_text(text)
    scenario = (folder / "scenario.yaml").read_text()
    (folder / "scenario.yaml").write_text(
        scenario.replace("student-airrace", str(tmp_path / "gone.yaml"))
    )
    log = RaceLog(folder / "race.mcap")
    log.attach("track.yaml", text)
    log.close()
    (tmp_path / "gone.yaml").unlink()
    assert load_run(folder).track.name == "gone"
    (folder / "race.mcap").unlink()
    with pytest.raises(UserError, match="gone.yaml"):
        load_run(folder)


@pytest.mark.parametrize(
    "name, text, words",
    [
        ("race.json", None, "race.json cannot be read .No such file.*; name the folder"),
        ("race.json", "{}", "is no race.json: .*; name the folder"),
        ("race.json", "[", "is no race.json: .*; name the folder"),
        ("scenario.yaml", None, "scenario.yaml"),
        ("race.mcap", "nothing", "race.mcap is no MCAP file"),
    ],
)
def test_bad_folders(tmp_path, capsys, name, text, words):
    folder = make_run(tmp_path / "run", laps=1)
    (folder / name).unlink()
    if text is not None:
        (folder / name).write_text(text)
    with pytest.raises(UserError, match=words):
        load_run(folder)
    assert main([str(folder)]) == 2
    lines = [
        line for line in capsys.readouterr().err.splitlines() if not line.startswith("Reading")
    ]
    assert len(lines) == 1


def test_without_pyarrow_one_sentence_says_what_to_do(run, tmp_path, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(UserError, match="pip install 'airrace.analysis.', or export as csv"):
        run.export(tmp_path, "parquet")


@pytest.mark.parametrize(
    "topic, message, words",
    [
        ("/map", {"map": {"gates": 3}}, "a message of /map is not as"),
        ("/plan", {"lap": 1, "gate_times": [0.0], "step": "x"}, "a message of /plan is not as"),
        ("/referee/crossings", {"time": 1}, "a message of /referee/crossings is not as"),
        ("/imu", {"time": 1, "angular_velocity": [], "specific_force": 1}, "a message of /imu is"),
        (
            "/referee/crossings",
            {"time": 1e300, "gate": 1, "lap": 1, "offset": 0.0, "max_speed": 1.0},
            "the signal crossings is not as",
        ),
    ],
)
def test_messages_of_another_shape(tmp_path, topic, message, words):
    folder = make_run(tmp_path / "run", laps=1, recorded=False)
    log = RaceLog(folder / "race.mcap")
    log.write(topic, 1.0, message)
    log.close()
    with pytest.raises(UserError, match=f"race.mcap: {words}"):
        load_run(folder)


@pytest.mark.parametrize(
    "name, words",
    [
        ("track.yaml", "The track in .*race.mcap cannot be raced: "),
        ("vehicle.yaml", "The vehicle in .*race.mcap cannot fly: "),
    ],
)
def test_a_log_whose_track_or_drone_cannot_be(tmp_path, name, words):
    folder = make_run(tmp_path / "run", laps=1, recorded=False)
    log = RaceLog(folder / "race.mcap")
    log.attach(name, "{}")
    log.close()
    with pytest.raises(UserError, match=words):
        load_run(folder)


def test_a_damaged_log_says_so_in_tables_and_report(tmp_path, capsys):
    folder = make_run(tmp_path / "run", laps=1)
    data = bytearray((folder / "race.mcap").read_bytes())
    data[len(data) // 4] ^= 1
    (folder / "race.mcap").write_bytes(data)
    for words in (["tables"], ["report"]):
        assert command([*words, str(folder)]) == 0
        assert "race.mcap is damaged at" in capsys.readouterr().err
    assert "race.mcap is damaged at" in (folder / "report.html").read_text()
