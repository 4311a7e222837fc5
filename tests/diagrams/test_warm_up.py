"""Compiling before a race in real time."""

import subprocess
import sys

from tests.diagrams.conftest import hexagon  # noqa: F401  # a fixture

PROGRAM = """
import gc, pathlib, sys
from numba.core.dispatcher import Dispatcher
from airrace.diagrams.runner import run_race
from airrace.diagrams.scenario import Scenario
from airrace.diagrams.warm_up import warm_up

def compiled():
    return {(each.py_func.__module__, each.py_func.__name__, str(signature))
            for each in gc.get_objects() if isinstance(each, Dispatcher)
            for signature in each.signatures}

warm_up(Scenario())
before = compiled()
assert len(before) > 20
track, folder = sys.argv[1:]
assert run_race(Scenario(track=track, laps=1), pathlib.Path(folder))["finished"]
print(*sorted(compiled() - before), sep="\\n")
"""


def test_nothing_is_left_to_compile_in_the_race(hexagon, tmp_path):  # noqa: F811
    done = subprocess.run([sys.executable, "-c", PROGRAM, hexagon, str(tmp_path)],
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert not done.stdout.strip(), done.stdout
