"""Compiling before a race in real time."""

import subprocess
import sys

import cv2
import pytest

from airrace.hitl.link.image_messages import decode_pictures
from airrace.hitl.link.messages import CAMERA_INFO
from airrace.hitl.playback import NavigatorPlayback, standing
from airrace.scenario import Scenario
from airrace.track.track import Gate

PROGRAM = """
import gc, pathlib, sys
from numba.core.dispatcher import Dispatcher
from airrace.diagrams.race import run_race
from airrace.scenario import LINK_DELAY, Scenario
from airrace.hitl.simulated_link import SimulatedRemote
from airrace.hitl.playback import LINK
from airrace.hitl.warm_up import warm_up, warm_up_navigator, warm_up_pilot

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
    "functions, others", [("warm_up,", ()), ("warm_up_pilot, warm_up_navigator", SIMULATION)]
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
