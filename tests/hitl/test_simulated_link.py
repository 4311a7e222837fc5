"""Races over bad links, in simulated time: the same in every run."""

import json

import pytest

from airrace.diagrams.race import run_race
from airrace.hitl.link.simulated_bus import LinkConfig, SimulatedLink
from airrace.hitl.simulated_link import SimulatedRemote
from airrace.scenario import LINK_DELAY, Scenario


def race(hexagon, tmp_path, link, time_limit, stall=(0.0, 0.0), **fields):
    """Args: stall: from when to when the autonomy does nothing (s)."""
    scenario = Scenario(track=hexagon, laps=1, trajectory="4", link_delay=LINK_DELAY, **fields)
    scenario.referee.time_limit = time_limit
    scenario.camera.width, scenario.camera.height, scenario.camera.fps = 640, 360, 15.0
    folder = tmp_path / "autonomy"
    folder.mkdir(exist_ok=True)
    modes = []

    class Watched(SimulatedRemote):
        def _let_autonomy_step(self, now):
            if not stall[0] <= now < stall[1]:
                super()._let_autonomy_step(now)

        def advance(self, simulator, end):
            result = super().advance(simulator, end)
            modes.append((end, int(self._watchdog_memory(simulator.get_context()).mode)))
            return result

    result = run_race(scenario, tmp_path, transport=Watched(scenario, LinkConfig(**link), folder))
    result["wall"].pop("seconds")
    result["wall"].pop("real_time_factor")
    return result, dict(modes)


@pytest.mark.repeats
def test_delay_jitter_and_loss_do_not_stop_a_race_and_are_the_same_twice(hexagon, tmp_path):
    link = dict(delay=0.02, jitter=0.005, loss=0.01)
    first, _ = race(hexagon, tmp_path, link, 4.0)
    second, _ = race(hexagon, tmp_path, link, 4.0)
    channels = first["wall"]["link"].pop("channels")
    second["wall"]["link"].pop("channels")
    assert first["wall"].pop("date") <= second["wall"].pop("date")
    assert json.dumps(first) == json.dumps(second)
    states = [event["state"] for event in first["exploration"]["events"]]
    assert states[:2] == ["CALIBRATE", "TAKE_OFF"] and states[-1] == "FLY_TO_GATE"
    assert first["wall"]["link"]["watchdog"]["hovers"] == 0
    assert channels["AIRRACE_ROTOR_SPEED_COMMAND"]["missing"] > 10


@pytest.mark.repeats
def test_over_a_link_a_drone_knows_where_it_is_from_what_it_measures(hexagon, tmp_path):
    link = dict(delay=0.02, jitter=0.005, loss=0.01)
    result, _ = race(hexagon, tmp_path, link, 5.0, estimator="vio")
    states = [event["state"] for event in result["exploration"]["events"]]
    assert states[:2] == ["CALIBRATE", "TAKE_OFF"] and states[-1] == "FLY_TO_GATE"
    assert result["collisions"] == 0 and result["wall"]["link"]["watchdog"]["hovers"] == 0
    assert result["dnf_reason"].startswith("ran out of time")


@pytest.mark.slow
def test_a_cable_that_is_pulled(hexagon, tmp_path):
    """For 0.2 s: nothing but a hold. For 1 s: a hover, and on. For good: down."""
    link = dict(cuts=((4.0, 4.2), (5.0, 6.0), (8.0, 1e9)))
    result, modes = race(hexagon, tmp_path, link, 60.0)
    at = {round(time, 1): mode for time, mode in modes.items()}
    assert max(at[time] for time in (3.9, 4.0, 4.1, 4.2, 4.3)) == 1
    assert at[5.8] == 2 and at[6.5] == 0 and at[7.5] == 0
    assert at[9.0] == 2 and at[11.0] == 3
    assert not result["finished"] and result["collisions"] == 0
    assert result["dnf_reason"].startswith("the autonomy fell silent at 7.")
    assert result["dnf_reason"].endswith("and the drone landed by itself")
    watchdog = result["wall"]["link"]["watchdog"]
    assert (watchdog["holds"], watchdog["hovers"], watchdog["landings"]) == (3, 2, 1)


@pytest.mark.repeats
def test_an_autonomy_that_does_nothing_for_a_while(hexagon, tmp_path):
    """As of a computer that is busy: it is back at once, and nothing of the kind was a delay."""
    link = dict(delay=0.02, jitter=0.005, loss=0.01)
    result, modes = race(hexagon, tmp_path, link, 8.0, stall=(5.0, 6.0))
    at = {round(time, 1): mode for time, mode in modes.items()}
    assert at[5.4] == 1 and at[5.9] == 2
    assert not any(mode for time, mode in at.items() if time > 6.05)
    assert result["wall"]["link"]["watchdog"]["oldest_command_s"] < 1.1
    assert result["collisions"] == 0 and result["dnf_reason"].startswith("ran out of time")


@pytest.mark.parametrize("loss, sent", [(0.0, 1.0), (0.5, 0.5)])
def test_the_simulated_bus_loses_what_it_says(loss, sent):
    link = SimulatedLink(LinkConfig(delay=0.01, loss=loss))
    sender, bus = link.bus(), link.bus()
    got = []
    bus.subscribe("A", lambda channel, data: got.append(data))
    for k in range(2000):
        sender.publish("A", bytes(10))
    assert not bus.hand_over()
    link.time = 0.02
    while bus.hand_over():
        pass
    assert len(got) == pytest.approx(2000 * sent, abs=100)
