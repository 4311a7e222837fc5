import re

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator

from airrace.diagrams.visualization import MakeMeshcat, PathVisualizer
from airrace.systems.lap_plan import NO_PLAN
from airrace.track import load_track


@pytest.fixture(scope="module")
def meshcat():
    return MakeMeshcat(load_track("student-airrace"))


def test_serves_on_loopback_only(meshcat):
    assert re.match(r"http://(localhost|127\.0\.0\.1):\d+$", meshcat.web_url())


def test_draws_the_flown_path_in_pieces(meshcat):
    paths = PathVisualizer(meshcat=meshcat, period=0.1)
    simulator = Simulator(paths)
    context = simulator.get_mutable_context()
    state = np.zeros(13)
    paths.GetInputPort("truth.state").FixValue(context, state)
    paths.GetInputPort("lap_plan").FixValue(context, Value[object](NO_PLAN))
    simulator.AdvanceTo(7.05)
    assert meshcat.HasPath("flown/0") and meshcat.HasPath("flown/1")
    assert not meshcat.HasPath("flown/2")
    assert not meshcat.HasPath("planned/circuit")
    assert meshcat.HasPath("here")
