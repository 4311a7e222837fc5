"""A pilot and its navigator: what one does when the other one falls silent or takes long."""

from pathlib import Path

import pytest

from airrace.diagrams.race import run_race
from airrace.hitl.handover import queue_pair
from airrace.hitl.link.endpoint import AUTONOMY, HEARTBEAT, Endpoint
from airrace.hitl.link.simulated_bus import LinkConfig, SimulatedLink
from airrace.hitl.navigator import Navigator
from airrace.hitl.pilot import Pilot, make_halves
from airrace.hitl.simulated_link import SimulatedRemote
from airrace.scenario import LINK_DELAY, Scenario


class Slow(SimulatedRemote):
    """A race whose navigator does nothing from one time to another (s)."""

    def __init__(self, scenario, folder, start, end):
        super().__init__(scenario, LinkConfig(delay=0.005), folder)
        self.silence, self.modes = (start, end), {}

    def _let_autonomy_step(self, now):
        self._poll_autonomy("racing")
        self._pilot.step()
        if not self.silence[0] <= now < self.silence[1]:
            self._navigator.step()

    def advance(self, simulator, end):
        result = super().advance(simulator, end)
        self.modes[round(end, 1)] = int(self._watchdog_memory(simulator.get_context()).mode)
        return result


def race(hexagon, folder, silence, time_limit):
    scenario = Scenario(track=hexagon, laps=1, link_delay=LINK_DELAY)
    scenario.referee.time_limit = time_limit
    scenario.camera.width, scenario.camera.height, scenario.camera.fps = 640, 360, 15.0
    (folder / "autonomy").mkdir()
    transport = Slow(scenario, folder / "autonomy", *silence)
    return run_race(scenario, folder, transport=transport), transport.modes


@pytest.mark.repeats
def test_a_navigator_that_is_busy_for_a_while_stops_nobody(hexagon, tmp_path):
    """For half a second the drone goes on where it was going."""
    result, modes = race(hexagon, tmp_path, (4.0, 4.5), 6.0)
    assert not any(modes.values()) and result["collisions"] == 0
    states = [event["state"] for event in result["exploration"]["events"]]
    assert states[-1] == "FLY_TO_GATE"
    assert result["dnf_reason"].startswith("ran out of time")


@pytest.mark.slow
def test_a_navigator_that_falls_silent_is_as_a_link_that_failed(hexagon, tmp_path):
    """The pilot sends no more commands, and the flight controller hovers and lands."""
    result, modes = race(hexagon, tmp_path, (4.0, 1e9), 60.0)
    assert modes[4.9] == 0 and modes[5.3] == 1 and modes[5.8] == 2 and modes[7.5] == 3
    assert not result["finished"] and result["collisions"] == 0
    assert result["dnf_reason"].startswith("the autonomy fell silent at 5.")
    assert result["dnf_reason"].endswith("and the drone landed by itself")


def listens(bus):
    return {subscription.channel for subscription in bus._subscriptions}


@pytest.mark.parametrize("estimator", ["truth", "vio"])
def test_no_picture_reaches_the_pilot(estimator):
    """Nor the navigator what only the pilot needs."""
    scenario = Scenario(estimator=estimator)
    link, halves = SimulatedLink(LinkConfig()), make_halves(scenario)
    channels = halves.channels(scenario)
    here, there = queue_pair()
    bus = link.bus()
    endpoint = Endpoint(AUTONOMY, channels, bus, link.clock)
    Pilot(scenario, halves, endpoint, here)
    sensors = {"truth": "AIRRACE_STATE_ESTIMATE", "vio": "AIRRACE_IMU"}
    assert listens(bus) == {HEARTBEAT, "AIRRACE_ROTOR_STATUS", sensors[estimator]}
    halves, bus = make_halves(scenario), link.bus()
    Navigator(scenario, halves, bus, there, output_dir=Path(), session=endpoint.session)
    assert listens(bus) == {HEARTBEAT, "AIRRACE_CAMERA", "AIRRACE_CAMERA_INFO"}
