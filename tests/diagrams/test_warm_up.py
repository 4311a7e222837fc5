"""Compiling before a race in real time."""

import subprocess
import sys

import numba
import pytest

from airrace.common import jit
from airrace.diagrams import warm_up
from airrace.scenario import load_scenario

PROGRAM = """
import gc, pathlib, sys
from numba.core.dispatcher import Dispatcher
from airrace.diagrams.race import run_race
from airrace.scenario import LINK_DELAY, Scenario
from airrace.diagrams.simulated_link import SimulatedRemote
from airrace.diagrams.warm_up import LINK, warm_up

def compiled():
    return {(each.py_func.__module__, each.py_func.__name__, str(signature))
            for each in gc.get_objects() if isinstance(each, Dispatcher)
            for signature in each.signatures}

warm_up(Scenario())
before = compiled()
assert len(before) > 20
scenario = Scenario(laps=1, link_delay=LINK_DELAY)
scenario.referee.time_limit = 9.0
folder = pathlib.Path(sys.argv[1])
run = run_race(scenario, folder, transport=SimulatedRemote(scenario, LINK, folder))
assert "gate 2" in run["dnf_reason"], run["dnf_reason"]
print(*sorted(compiled() - before), sep="\\n")
"""


@pytest.mark.slow
def test_nothing_is_left_to_compile_in_the_race(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(tmp_path)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert not done.stdout.strip(), done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("on_disk, renderer", [(False, "none"), (True, "planar")])
def test_another_process_compiles_the_first_time(monkeypatch, tmp_path, capsys, on_disk, renderer):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    (tmp_path / "of_a_module").mkdir()  # Numba makes it before it compiles
    if on_disk:
        (tmp_path / "of_a_module" / "function.nbc").touch()
    assert jit.is_on_disk() == on_disk
    ran, run = [], subprocess.run
    monkeypatch.setattr(subprocess, "run", lambda *args, **kwargs: ran.append(run(*args, **kwargs)))
    warm_up.compile_apart(
        load_scenario(
            scenario_text=f"{{map: track, camera: {{renderer: {renderer}}}, systems: "
            "{trajectory_tracker: 'tests.diagrams.test_warm_up:make_tracker', "
            "geometric_controller: '__main__:only_in_a_script'}}"
        )
    )
    assert [each.returncode for each in ran] == ([] if on_disk else [0]), ran[0].stderr
    assert capsys.readouterr() == ("", "")  # a clock is for terminals


def make_tracker(scenario):
    """A box of the tests, which only this process's path leads to."""
    from airrace.systems.planning.trajectory_tracker import TrajectoryTracker

    return TrajectoryTracker()
