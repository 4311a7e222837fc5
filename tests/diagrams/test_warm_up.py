"""Compiling before a race in real time."""

import subprocess
import sys
import threading

import cv2
import numba
import pytest

from airrace.common import jit
from airrace.diagrams import warm_up
from airrace.diagrams.made_up_messages import standing
from airrace.diagrams.playback import NavigatorPlayback
from airrace.hitl.link.image_messages import decode_pictures
from airrace.hitl.link.messages import CAMERA_INFO
from airrace.scenario import TRUTH, VIO, Scenario, load_scenario
from airrace.track.track import Gate

PROGRAM = """
import gc, pathlib, sys
from numba.core.dispatcher import Dispatcher
from airrace.diagrams.race import run_race
from airrace.scenario import LINK_DELAY, Scenario
from airrace.diagrams.simulated_link import SimulatedRemote
from airrace.diagrams.playback import LINK
from airrace.diagrams.warm_up import warm_up, warm_up_navigator, warm_up_pilot

def compiled():
    return {{(each.py_func.__module__, each.py_func.__name__, str(signature))
            for each in gc.get_objects() if isinstance(each, Dispatcher)
            for signature in each.signatures}}

for each in ({warm_up}):
    each(Scenario())
before = compiled()
assert len(before) > 10
scenario = Scenario(laps=1, link_delay=LINK_DELAY)
scenario.referee.time_limit = 9.0
folder = pathlib.Path({folder!r})
run = run_race(scenario, folder, transport=SimulatedRemote(scenario, LINK, folder))
assert "gate 2" in run["dnf_reason"], run["dnf_reason"]
for each in sorted(compiled() - before):
    print(*each)
"""


# What simulates and draws, and what these call.
SIMULATION = (
    "airrace.rendering.",
    "airrace.systems.plant.",
    "airrace.systems.referee ",
    "airrace.systems.sensing.camera_view ",
    "airrace.systems.sensing.state_estimate ",
    "airrace.common.jit assign ",
)


@pytest.mark.repeats
@pytest.mark.parametrize(
    "functions, others", [("warm_up_pilot, warm_up_navigator", SIMULATION), ("warm_up,", ())]
)
def test_nothing_is_left_to_compile_in_the_race(tmp_path, functions, others):
    program = PROGRAM.format(warm_up=functions, folder=str(tmp_path))
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    left = done.stdout.splitlines()
    assert [line for line in left if not line.startswith(others)] == []
    assert bool(left) == bool(others)  # the autonomy alone compiles nothing of those


def test_pictures_for_a_computer_without_a_renderer(tmp_path):
    """Both markers of the gate that they show are found where they are."""
    scenario = Scenario()
    playback = NavigatorPlayback(scenario, tmp_path)
    messages = standing(scenario, playback.channels, 0.1)
    assert [each.time for each in messages] == sorted(each.time for each in messages)
    (picture, *_) = (each for each in messages if each.channel == "AIRRACE_CAMERA")
    (info, *_) = (each for each in messages if each.channel == "AIRRACE_CAMERA_INFO")
    info = CAMERA_INFO.decode(info.message)
    pictures, _ = decode_pictures(picture.message)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_ARUCO_ORIGINAL)
    corners, ids, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(pictures["grey"])
    found = dict(zip(ids.ravel().tolist(), corners))
    assert found.keys() == {0, 2}
    for board in Gate(left_pylon=[15.0, 5.0], heading_deg=0.0).boards(0):
        if board.id in found:
            p_C = info.X_BC.inverse() @ board.X_WM.translation()
            pixel = (info.K @ p_C)[:2] / p_C[2]
            assert found[board.id][0].mean(axis=0) == pytest.approx(pixel, abs=1.0)


@pytest.fixture
def started(monkeypatch, tmp_path):
    """The processes that are started; their machine code would be kept in another folder."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "machine_code"))
    started, start = [], subprocess.Popen

    def note(*args, **kwargs):
        started.append(start(*args, **kwargs))
        return started[-1]

    monkeypatch.setattr(subprocess, "Popen", note)
    return started


@pytest.mark.slow
def test_other_processes_compile_the_first_time(started, capsys):
    scenario = load_scenario(
        scenario_text="{map: track, camera: {renderer: none}, systems: "
        "{trajectory_tracker: 'tests.diagrams.test_warm_up:make_tracker', "
        "geometric_controller: '__main__:only_in_a_script'}}"
    )
    for _ in range(2):  # the second time it has been done
        warm_up.compile_apart(scenario)
        assert [process.returncode for process in started] == [0, 0]
    assert jit.is_complete(TRUTH) and not jit.is_complete(VIO)
    assert capsys.readouterr() == ("", "")  # a clock is for terminals


def test_what_cannot_be_compiled_is_not_noted(started, monkeypatch):
    monkeypatch.setattr(sys, "executable", "/bin/false")
    warm_up.compile_apart(Scenario())
    assert [process.returncode for process in started] == [1, 1] and not jit.is_complete(TRUTH)


def test_races_that_start_at_once_compile_once(started):
    with jit.locked():
        other = threading.Thread(target=warm_up.compile_apart, args=[Scenario()])
        other.start()
        other.join(0.2)
        assert other.is_alive()  # it waits, while this race compiles:
        jit.set_complete(TRUTH)
    other.join()
    assert started == []


def make_tracker(scenario):
    """A box of the tests, which only this process's path leads to."""
    from airrace.systems.planning.trajectory_tracker import TrajectoryTracker

    return TrajectoryTracker()
