"""Compiling before a race in real time."""

import subprocess
import sys

PROGRAM = """
from airrace.diagrams.scenario import Scenario
from airrace.diagrams.warm_up import warm_up
from airrace.rendering import background, enlarging, painting, scene_polygons, sensor
from airrace.systems import geometric_controller, rotor_bank, state_filter

warm_up(Scenario())
for module, names in (
    (background, ["_draw_small"]), (enlarging, ["enlarge"]), (scene_polygons, ["look"]),
    (painting, ["paint"]), (sensor, ["_expose"]),
    (geometric_controller, ["_prepared", "_wrench", "_command"]), (rotor_bank, ["_turn"]),
    (state_filter, ["_carry_forward", "_update"]),
):
    for name in names:
        assert getattr(module, name).signatures, name
"""


def test_what_a_race_calls_in_its_inner_loops_is_compiled_then():
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
