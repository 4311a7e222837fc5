"""A pilot and its navigator: what one does when the other one falls silent or takes long."""

import dataclasses as dc
from pathlib import Path

import numpy as np
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


class Told(Slow):
    """Such a race, beside which a board is told thrust and rates."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.told = {}

    def _let_autonomy_step(self, now):
        super()._let_autonomy_step(now)
        self.told[round(now, 3)] = self._pilot.rate_command


def test_a_board_is_told_thrust_and_rates_while_somebody_leads(hexagon, tmp_path):
    scenario = Scenario(track=hexagon, laps=1, link_delay=LINK_DELAY)
    scenario.referee.time_limit = 3.0
    scenario.camera.width, scenario.camera.height = 640, 360
    beside = dc.replace(scenario, flight_controller="msp:/dev/ttyACM0", betaflight_config="dump")
    (tmp_path / "autonomy").mkdir()
    transport = Told(beside, tmp_path / "autonomy", 1.5, 1e9)
    run_race(scenario, tmp_path, transport=transport)
    in_flight = [told for time, told in transport.told.items() if 1.0 < time < 2.0]
    assert 9.0 < np.mean(in_flight, axis=0)[0] < 15.0  # it climbs
    assert np.abs(in_flight)[:, 1:].max() < 1.5  # rad/s: it only levels and turns to gate 1
    assert transport.told[2.9] is None


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
