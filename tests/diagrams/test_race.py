import json
import os
import re
import signal
import subprocess
import sys
import textwrap
import time

import numpy as np
import pytest

from airrace.commands.app import main as airrace
from airrace.common.errors import OwnCodeError, UserError
from airrace.diagrams import race as race_module
from airrace.diagrams.race import run_race
from airrace.recording.race_events import StateSample
from airrace.scenario import Scenario, load_scenario
from airrace.track import load_track
from tests.worlds.cases import first
from tests.worlds.looks import Looks

FILES = {"scenario.yaml", "map.json", "map_statistics.json", "race.json", "race.mcap"}


def refuse(word):
    raise AssertionError(f"{word} is not JSON")


def read_race(folder):
    """Checks that all files of a race are there and valid; returns race.json."""
    assert {path.name for path in folder.iterdir()} - {
        "race.html",
        "report.html",
        "error.txt",
    } == FILES
    scenario = load_scenario(filename=str(folder / "scenario.yaml"))
    scenario.check()
    data = {
        name: json.loads((folder / name).read_text(), parse_constant=refuse)
        for name in FILES
        if name.endswith(".json")
    }
    check_laps(data["race.json"], len(load_track(scenario.track).gates), scenario.laps)
    return data["race.json"]


def check_laps(data, gates, laps):
    """Checks that what race.json says of its laps agrees; its fields are tested in tests/recording."""
    assert data["finished"] == (data["dnf_reason"] is None) == (len(data["laps"]) == laps)
    assert [lap["lap"] for lap in data["laps"]] == list(range(1, len(data["laps"]) + 1))
    for lap in data["laps"]:
        assert len(lap["gate_times_s"]) == len(lap["gate_offsets_m"]) == gates
    times = [lap["time_s"] for lap in data["laps"]]
    assert data["best_lap_s"] == min(times, default=None)
    assert data["mean_lap_s"] == (pytest.approx(np.mean(times)) if times else None)


def comparable(data):
    """race.json without what depends on the machine."""
    data = json.loads(json.dumps(data))
    del data["wall"]
    return data


def short(time_limit=2.0, **fields):
    scenario = Scenario(**fields)
    scenario.referee.time_limit = time_limit
    return scenario


@pytest.fixture(scope="module")
def flown(hexagon, tmp_path_factory):
    """A whole race from pixels: its folder, and race.json as it was at every look."""
    folder = tmp_path_factory.mktemp("flown")
    scenario = Scenario(track=hexagon, laps=2, trajectory="4", seed=4)
    scenario.referee.time_limit = 120.0
    scenario.camera.fps = 15.0  # half of the usual pictures, to save time
    looks = Looks()

    def take(event):
        looks.take(event)
        if isinstance(event, StateSample):
            looks[-1].on_disk = json.loads((folder / "race.json").read_text())

    result = run_race(scenario, folder, sinks=[take])
    return folder, result, looks


@pytest.mark.slow
class TestWholeRace:
    def test_it_is_finished(self, flown):
        folder, result, _ = flown
        data = read_race(folder)
        assert data == result
        assert data["finished"] and data["dnf_reason"] is None and data["collisions"] == 0
        assert (data["track"], data["drone"]) == ("hexagon", "Default")
        assert data["wall"]["simulation"] == "SITL"
        assert (data["trajectory"], data["seed"]) == ("4", 4)
        assert data["exploration"]["success"] and data["exploration"]["gates_found"] == 6
        assert 10 < data["exploration"]["time_s"] < 100

    def test_its_laps_are_plausible(self, flown):
        for lap in flown[1]["laps"]:
            assert lap["gate_times_s"][0] == 0.0
            assert np.all(np.diff([*lap["gate_times_s"], lap["time_s"]]) > 0)
            assert 0 <= min(lap["gate_offsets_m"]) and max(lap["gate_offsets_m"]) < 1.0
            assert 0 < lap["map_rms_m"] < 0.5
            plan = lap["plan"]
            assert plan["max_speed"] <= 20.0 and plan["max_acceleration"] <= 10.0
            assert lap["time_s"] == pytest.approx(plan["duration_s"], rel=0.1)
            assert lap["max_speed"] == pytest.approx(plan["max_speed"], rel=0.1)

    def test_laps_are_on_disk_as_they_end(self, flown):
        for look in flown[2]:
            crossings = len(look.crossings)
            assert len(look.on_disk["laps"]) == max(crossings - 1, 0) // 6
            check_laps(look.on_disk, 6, 2)
        first = next(look for look in flown[2] if len(look.crossings) > 6)
        assert first.on_disk["laps"] == flown[1]["laps"][:1]
        assert first.on_disk["dnf_reason"] == "not over yet"

    def test_the_map_is_on_disk(self, flown):
        folder, _, looks = flown
        gates = json.loads((folder / "map.json").read_text())["gates"]
        assert [gate["gate"] for gate in gates] == [1, 2, 3, 4, 5, 6]
        assert json.loads((folder / "map.json").read_text())["time_s"] == looks[-1].gate_map.time
        statistics = json.loads((folder / "map_statistics.json").read_text())
        assert statistics["detections"] > 500 and statistics["error_rate"] < 0.01

    @pytest.mark.repeats
    def test_its_scenario_gives_the_same_race_again(self, flown, tmp_path, monkeypatch, capsys):
        """By the command line, from another folder, and with a spectator."""
        folder, result, _ = flown
        monkeypatch.chdir(tmp_path)
        code = airrace(
            [
                "race",
                "--scenario_file",
                str(folder / "scenario.yaml"),
                "--no-report",
                "--output",
                "again",
            ]
        )
        assert code == 0
        again = read_race(tmp_path / "again")
        assert comparable(again) == comparable(result)
        for name in ("scenario.yaml", "map.json", "map_statistics.json"):
            assert (tmp_path / "again" / name).read_text() == (folder / name).read_text()
        html = (tmp_path / "again" / "race.html").read_text()
        assert "</html>" in html and len(html) < 30e6
        out, err = capsys.readouterr()
        assert f"Finished: mean lap {result['mean_lap_s']:.2f} s" in out
        assert out.splitlines()[-1] == "Results: again"


class TestShortFlights:
    @pytest.mark.slow
    def test_the_seed_decides(self, tmp_path):
        states = {name: Looks() for name in "abc"}
        for name, seed in (("a", 3), ("b", 3), ("c", 4)):
            (tmp_path / name).mkdir()
            result = run_race(short(seed=seed), tmp_path / name, sinks=[states[name].take])
            assert result == read_race(tmp_path / name)
            assert result["seed"] == seed
            assert result["dnf_reason"].startswith("ran out of time in state TAKE_OFF: level")
            states_entered = [e["state"] for e in result["exploration"].pop("events")]
            assert states_entered == ["CALIBRATE", "TAKE_OFF"]
            assert result["exploration"] == {
                "success": False,
                "time_s": pytest.approx(2.0),
                "gates_found": 0,
            }
        a, b, c = ([look.state.tolist() for look in states[name]] for name in "abc")
        assert a == b != c
        same = [comparable(read_race(tmp_path / name)) for name in "ab"]
        assert same[0] == same[1]

    def test_every_file_is_there_from_the_first_look_on(self, tmp_path):
        def take(event):
            data = read_race(tmp_path)
            assert data["dnf_reason"] == "not over yet" and data["laps"] == []
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            run_race(short(), tmp_path, sinks=[take])

    def test_looks_come_at_round_times(self, tmp_path):
        looks = Looks()
        run_race(short(1.0), tmp_path, sinks=[looks.take])
        times = [look.time for look in looks]
        np.testing.assert_allclose(times, 0.1 * np.arange(1, len(times) + 1), rtol=0, atol=1e-12)

    def test_signal_handlers_are_given_back(self, tmp_path):
        before = [signal.getsignal(s) for s in (signal.SIGINT, signal.SIGTERM)]
        during = []
        run_race(
            short(0.2),
            tmp_path,
            sinks=[
                lambda _: during.append(
                    [signal.getsignal(s) for s in (signal.SIGINT, signal.SIGTERM)]
                )
            ],
        )
        assert [signal.getsignal(s) for s in (signal.SIGINT, signal.SIGTERM)] == before
        assert all(handlers != before for handlers in during)

    def test_the_second_ctrl_c_means_it(self, tmp_path):
        def take(event):
            if event.time > 0.25:
                os.kill(os.getpid(), signal.SIGINT)  # only sets a flag
                os.kill(os.getpid(), signal.SIGINT)
                pytest.fail("still flying")

        with pytest.raises(KeyboardInterrupt):
            run_race(short(), tmp_path, sinks=[take])
        assert read_race(tmp_path)["dnf_reason"] == "interrupted"

    def test_ctrl_c_before_the_first_look(self, tmp_path, monkeypatch):
        """The files are written with no flight at all."""

        def interrupted_write(*args):
            os.kill(os.getpid(), signal.SIGINT)
            write_map(*args)

        write_map = race_module.write_map
        monkeypatch.setattr(race_module, "write_map", interrupted_write)
        data = run_race(short(), tmp_path, sinks=[lambda event: pytest.fail("flew")])
        assert data == read_race(tmp_path)
        assert data["dnf_reason"] == "interrupted"


FAULTY = """
    from airrace.common.errors import UserError
    from airrace.systems.control.geometric_controller import GeometricController
    from airrace.systems.mapping.gate_mapper import GateMapper
    from airrace.systems.planning.trajectory_tracker import TrajectoryTracker
    from airrace.vehicle import load_vehicle

    class Crash(Exception):
        pass

    class Tracker(TrajectoryTracker):
        after = 3.0

        def __init__(self, scenario):
            super().__init__()
            self.DeclarePeriodicPublishEvent(0.01, 0.0, self._look)

        def _look(self, context):
            if context.get_time() >= self.after:
                raise Crash("a student's mistake")

    class Leaver(Tracker):
        def _look(self, context):
            raise SystemExit(0)

    class TrackerAtOnce(Tracker):
        after = 0.0

    class UpsideDown(GeometricController):
        def __init__(self, scenario):
            super().__init__(vehicle=load_vehicle(scenario.drone)[0], rate=500.0)

        def calc_wrench(self, reference, estimate):
            return -super().calc_wrench(reference, estimate)

    class Careless(GeometricController):
        def calc_wrench(self, reference, estimate):
            return None

    careless = Careless.from_scenario

    class Mapper(GateMapper):
        "Nobody can have its map, not even when the race is over."
        def __init__(self, scenario):
            config = scenario.perception
            super().__init__(fps=30.0, latency=0.01, state_rate=200.0, config=config)

        mistakes = 0

        def _calc_map(self, context, output):
            if context.get_time() >= 1.0:
                self.mistakes += 1
                raise Crash("a student's mistake" if self.mistakes == 1 else "what comes of it")
            super()._calc_map(context, output)
"""


@pytest.fixture
def faulty_boxes(tmp_path, monkeypatch):
    (tmp_path / "systems").mkdir()
    (tmp_path / "systems" / "faulty_boxes.py").write_text(textwrap.dedent(FAULTY))
    monkeypatch.syspath_prepend(tmp_path / "systems")
    (tmp_path / "out").mkdir()
    return tmp_path / "out"


class TestFaults:
    @pytest.mark.slow
    @pytest.mark.parametrize(
        "systems, time_s",
        [
            ({"trajectory_tracker": "faulty_boxes:Tracker"}, 2.9),
            ({"trajectory_tracker": "faulty_boxes:TrackerAtOnce"}, 0.0),
            ({"gate_mapper": "faulty_boxes:Mapper"}, 0.9),
        ],
        ids=["at 3 s", "at once", "in an output"],
    )
    def test_a_box_that_raises(self, faulty_boxes, systems, time_s):
        with pytest.raises(OwnCodeError, match="a student's mistake") as e:
            run_race(short(5.0, systems=systems), faulty_boxes)
        assert type(e.value.__cause__).__name__ == "Crash"
        data, name = read_race(faulty_boxes), next(iter(systems.values())).replace(":", ".")
        assert (
            data["dnf_reason"].startswith(f"stopped by an error: {name}._") and not data["finished"]
        )
        assert "() raised Crash: a student's mistake (faulty_boxes.py, line " in data["dnf_reason"]
        assert "race/__init__.py" in (faulty_boxes / "error.txt").read_text()
        assert data["exploration"]["time_s"] == pytest.approx(time_s, abs=0.101)

    def test_a_box_that_calls_exit(self, faulty_boxes):
        """It would look like a race that has finished."""
        with pytest.raises(UserError, match=r"A system of the race has called exit\(0\)"):
            run_race(short(systems={"trajectory_tracker": "faulty_boxes:Leaver"}), faulty_boxes)
        assert "Leaver._look() raised SystemExit" in read_race(faulty_boxes)["dnf_reason"]

    def test_a_box_that_gives_what_is_not_wanted(self, faulty_boxes):
        with pytest.raises(UserError, match=r"faulty_boxes.Careless.calc_wrench\(\) gave None"):
            run_race(short(systems={"geometric_controller": "faulty_boxes:careless"}), faulty_boxes)
        reason = read_race(faulty_boxes)["dnf_reason"]
        assert reason.startswith(
            "stopped by an error: faulty_boxes.Careless.calc_wrench() gave None"
        )

    @pytest.mark.slow
    def test_a_controller_that_pushes_down(self, faulty_boxes, monkeypatch):
        """The drone never leaves its pad, and nobody waits for it for ever."""
        monkeypatch.setattr("airrace.systems.exploring.explorer_states._CLIMB", 2.0)
        scenario = short(100.0, systems={"geometric_controller": "faulty_boxes:UpsideDown"})
        scenario.camera.renderer, scenario.map = "none", "track"
        data = run_race(scenario, faulty_boxes)
        assert re.search(r"gave up at 5.\d s .*check the controller's thrust", data["dnf_reason"])
        assert data["dnf_reason"].endswith("and stayed on its pad")
        assert data["negative_thrusts"] > 100

    def test_a_sink_that_raises(self, tmp_path):
        def take(event):
            raise ZeroDivisionError("in the display")

        with pytest.raises(ZeroDivisionError):
            run_race(short(), tmp_path, sinks=[take])
        assert read_race(tmp_path)["dnf_reason"] == "stopped by an error"

    def test_a_disk_that_is_full_at_the_end(self, tmp_path, monkeypatch):
        """What was written before stays, and one sentence says what is wrong."""

        def take(event):
            if event.time > 1.45:
                monkeypatch.setattr("pathlib.Path.write_bytes", full)

        def full(self, *args, **kwargs):
            raise OSError(28, "No space left on device")

        with pytest.raises(UserError, match="cannot be written .No space left on device"):
            run_race(short(1.5), tmp_path, sinks=[take])
        monkeypatch.undo()
        assert read_race(tmp_path)["dnf_reason"] == "not over yet"

    def test_a_disk_that_is_full_in_flight(self, tmp_path, monkeypatch):
        monkeypatch.setattr(
            "airrace.systems.mapping.gate_map_writer.write_map", self._fail_with_user_error
        )
        with pytest.raises(UserError, match="map.json cannot be written"):
            run_race(short(1.5), tmp_path)
        assert read_race(tmp_path)["dnf_reason"] == "stopped by an error"

    @staticmethod
    def _fail_with_user_error(directory, gate_map):
        raise UserError(f"{directory}/map.json cannot be written (No space left on device).")

    def test_what_cannot_be_had_leaves_nothing(self, tmp_path):
        for fields in ({"track": "none"}, {"drone": "none"}, {"systems": {"none": "a:b"}}):
            with pytest.raises(UserError):
                run_race(Scenario(**fields), tmp_path)
        assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("signum, replay", first([(signal.SIGINT, True), (signal.SIGTERM, False)]))
def test_a_signal_in_mid_flight(tmp_path, signum, replay):
    log = tmp_path / "log"
    with open(log, "w") as file:
        process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "airrace",
                "race",
                "--output",
                str(tmp_path / "out"),
                "--meshcat" if replay else "--no-meshcat",
            ],
            stdout=file,
            stderr=subprocess.STDOUT,
            cwd=os.getcwd(),
            # A shell that started the tests in the background may ignore SIGINT.
            preexec_fn=lambda: signal.signal(signum, signal.SIG_DFL),
        )
    try:
        deadline = time.monotonic() + 60
        while "TAKE_OFF" not in log.read_text():
            assert process.poll() is None and time.monotonic() < deadline, log.read_text()
            time.sleep(0.02)
        process.send_signal(signum)
        assert process.wait(30) == 1
    finally:
        process.kill()
        process.wait()
    data = read_race(tmp_path / "out")
    assert (tmp_path / "out" / "race.html").exists() == replay
    assert "Did not finish: interrupted" in (tmp_path / "out" / "report.html").read_text()
    assert data["dnf_reason"] == "interrupted"
    assert data["exploration"]["time_s"] > 0.5
    text = log.read_text()
    assert "Did not finish: interrupted" in text and "Traceback" not in text
    assert text.splitlines()[-1] == f"Results: {tmp_path / 'out'}"


@pytest.mark.repeats
def test_half_as_many_pictures_are_enough(hexagon, tmp_path):
    """Explored and raced, for a board that is too slow for more."""
    scenario = load_scenario(
        scenario_text="{camera: {width: 640, height: 360, fps: 15}, recording: {content: none}}"
    )
    scenario.track, scenario.laps = hexagon, 1
    result = run_race(scenario, tmp_path)
    assert result["finished"] and result["collisions"] == 0, result["dnf_reason"]
    assert result["exploration"]["gates_found"] == 6
    assert result["laps"][0]["map_rms_m"] < 0.05
