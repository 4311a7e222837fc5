"""Starts from a tilted pad, with the real controller and physics."""

import dataclasses as dc

import numpy as np
import pytest
from pydrake.common.yaml import yaml_dump_typed
from pydrake.systems.analysis import Simulator

from airrace.diagrams.reference_flight import MakeFlight
from airrace.scenario import Scenario
from airrace.track import Track, load_track
from airrace.trajopt.flat_trajectory import hold, idle
from airrace.vehicle import RACERS

TAKE_OFF = 0.5  # s


def on_pad(tmp_path, drone, tilt_deg, direction_deg):
    """Returns a scenario whose reference track starts on a tilted pad."""
    track = load_track("student-airrace")
    start = dc.replace(track.start, pad_tilt_deg=tilt_deg, pad_tilt_direction_deg=direction_deg)
    path = tmp_path / "track.yaml"
    path.write_text(yaml_dump_typed(dc.replace(track, start=start), schema=Track))
    return Scenario(track=str(path), drone=drone, laps=1)


def tilt_of(state):
    return np.rad2deg(np.arccos(1 - 2 * (state[1] ** 2 + state[2] ** 2)))


@pytest.mark.parametrize("direction_deg", [0.0, 130.0])
@pytest.mark.parametrize("drone", RACERS)
def test_takes_off_from_a_tilted_pad_and_levels(tmp_path, drone, direction_deg):
    scenario = on_pad(tmp_path, drone, 10.0, direction_deg)
    pad = []

    def reference(time):
        if time < TAKE_OFF:
            return idle(pad[0], 0.0)
        return hold(pad[0] + [0.0, 0.0, 1.5 * (time - TAKE_OFF)], 0.0)

    pad.append(np.zeros(3))
    flight = MakeFlight(scenario, reference)
    simulator = Simulator(flight)
    context = simulator.get_mutable_context()
    state, report = (flight.GetOutputPort(name) for name in ("truth.state", "truth.referee_status"))
    pad[0] = state.Eval(context)[4:7].copy()
    assert tilt_of(state.Eval(context)) == pytest.approx(10.0)
    simulator.AdvanceTo(TAKE_OFF - 0.02)
    # It has stood there quietly, on its pad.
    np.testing.assert_allclose(state.Eval(context)[4:7], pad[0], atol=2e-3)
    assert tilt_of(state.Eval(context)) == pytest.approx(10.0, abs=0.2)
    simulator.AdvanceTo(3.0)
    assert not report.Eval(context).over
    np.testing.assert_allclose(state.Eval(context)[4:6], [0.0, 0.0], atol=0.3)
    assert state.Eval(context)[6] > 2.0
    assert tilt_of(state.Eval(context)) < 3.0
