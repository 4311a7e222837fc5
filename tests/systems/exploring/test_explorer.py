import dataclasses as dc
import re

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.math import RollPitchYaw
from pydrake.systems.analysis import Simulator

from airrace.diagrams.race import run_race
from airrace.scenario import ExplorerConfig, PerceptionConfig, Scenario
from airrace.systems.exploring.clear_paths import ABOVE_PYLONS
from airrace.systems.exploring.explorer import Explorer
from airrace.systems.types import Detections, ExplorerEvent
from airrace.track import Gate, Start, Track, load_track
from airrace.track.gate_map import GateMap
from airrace.track.generator import generate_track
from airrace.trajopt.reference import NO_LIFT, as_reference
from tests.worlds.cases import first
from tests.worlds.exploration import ExplorationWorld, clear_of_pylons, explore, make_explorer

REFERENCE = load_track("student-airrace")
CLEARANCE = 2.0
RADIUS = 0.35
RATE = 20.0


def run(track, seconds=300.0, **options):
    return explore(make_explorer(track), ExplorationWorld(track, **options), track, seconds)


def states(flown):
    return [event.state for event in flown.status.events]


def check_explored(flown, track):
    n = len(track.gates)
    assert flown.status.done, flown.status
    assert flown.status.gates == flown.crossings == tuple(range(n))
    assert clear_of_pylons(flown.path, track, RADIUS) > 0.0


def turned_start(degrees, track=REFERENCE):
    start = dc.replace(track.start, heading_deg=track.start.heading_deg + degrees)
    return dc.replace(track, start=start)


@pytest.fixture(scope="module")
def reference_run():
    return run(REFERENCE)


@pytest.mark.slow
def test_finds_all_gates_of_the_reference_track_in_order(reference_run):
    check_explored(reference_run, REFERENCE)
    assert reference_run.status.closed_at < 75.0


@pytest.mark.slow
@pytest.mark.parametrize("step_length", first([5.0, 2.0, 10.0, 25.0]))
def test_steps_of_any_length_find_all_gates_of_the_reference_track(step_length):
    explorer = make_explorer(REFERENCE, Scenario(explorer=ExplorerConfig(step_length=step_length)))
    flown = explore(explorer, ExplorationWorld(REFERENCE), REFERENCE, 300.0)
    check_explored(flown, REFERENCE)
    assert flown.status.closed_at < 75.0
    assert "GO_BACK" not in states(flown)


ORIGINAL = ExplorerConfig(
    step_length=5.0, hover_before_step=True, hover_time=1.0, reached_distance=3.0, expected_gates=10
)


@pytest.mark.slow
def test_it_can_explore_as_the_original_did():
    """It hovers for 1 s before each step of 5 m, and is done with ten gates."""
    flown = explore(
        make_explorer(REFERENCE, Scenario(explorer=ORIGINAL)),
        ExplorationWorld(REFERENCE),
        REFERENCE,
        300.0,
    )
    check_explored(flown, REFERENCE)
    check_hovers_before_steps(flown.status.events)
    (end,) = [event for event in flown.status.events if event.state == "RETURN"]
    assert end.reason == "all 10 gates that are expected were found"
    np.testing.assert_allclose(flown.path[-1], [0, 0, 5.1], atol=0.05)


def check_hovers_before_steps(events):
    before = [
        (last.state, event.time - last.time)
        for last, event in zip(events, events[1:])
        if event.state == "STEP_FORWARD"
    ]
    assert len(before) >= 8  # gate 6 is 70 m beyond gate 5
    for state, waited in before:
        assert state == "HOVER" and waited > ORIGINAL.hover_time - 2.0 / RATE


@pytest.mark.repeats
def test_from_pixels_it_can_explore_as_the_original_did(tmp_path):
    scenario = Scenario(explorer=ORIGINAL, laps=1, trajectory="4")
    scenario.recording.content = "none"
    scenario.camera.fps = 15.0  # which is enough, and saves time
    race = run_race(scenario, tmp_path)
    assert race["finished"] and race["collisions"] == 0
    assert race["exploration"]["success"] and race["exploration"]["gates_found"] == 10
    events = [
        ExplorerEvent(event["time_s"], event["state"], event["reason"])
        for event in race["exploration"]["events"]
    ]
    check_hovers_before_steps(events)
    assert "all 10 gates that are expected were found" in [event.reason for event in events]


@pytest.mark.slow
def test_states_follow_the_flow_chart(reference_run):
    entered = states(reference_run)
    assert entered[:4] == ["CALIBRATE", "TAKE_OFF", "HOVER", "HOVER"]
    assert entered[4] == "FLY_TO_GATE"
    assert entered[-2:] == ["RETURN", "DONE"]
    assert "STEP_FORWARD" in entered  # gate 6 is 70 m beyond gate 5
    status = reference_run.status
    assert all(event.reason for event in status.events)
    times = [event.time for event in status.events]
    assert times == sorted(times)
    assert (status.state, status.reason, status.since) == (
        status.events[-1].state,
        status.events[-1].reason,
        status.events[-1].time,
    )


@pytest.mark.slow
def test_legs_keep_to_the_limits(reference_run):
    velocity = np.diff(reference_run.path, axis=0) * RATE
    assert np.linalg.norm(velocity, axis=1).max() < 1.3 * ExplorerConfig().max_speed


@pytest.mark.slow
def test_ends_hovering_over_the_start(reference_run):
    np.testing.assert_allclose(reference_run.path[-1], [0, 0, 5.1], atol=0.05)


@pytest.mark.slow
def test_the_same_seed_flies_the_same(reference_run):
    again = run(REFERENCE, seconds=12.0)
    np.testing.assert_array_equal(again.path, reference_run.path[:240])
    assert not np.array_equal(run(REFERENCE, seconds=6.0, seed=1).path, again.path[:120])


@pytest.mark.slow
def test_does_not_stop_between_gates_in_sight():
    """From gate 1 to gate 4, each next gate shows before the last is passed."""
    flown = run(REFERENCE, seconds=30.0, perception=PerceptionConfig(max_range=45.0))
    times = {e.reason[:6]: e.time for e in flown.status.events if e.state == "FLY_TO_GATE"}
    speed = np.linalg.norm(np.diff(flown.path, axis=0), axis=1) * RATE
    assert speed[int((times["gate 1"] + 2) * RATE) : int(times["gate 4"] * RATE)].min() > 1.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", first(range(10)))
def test_explores_tracks_that_it_has_never_seen(seed):
    track = generate_track(seed)
    check_explored(run(track, seed=seed), track)


@pytest.mark.parametrize("off", [25.0, -25.0])
def test_turns_to_gate_1_before_it_flies(off):
    flown = run(turned_start(off), seconds=8.0)
    turn = next(e for e in flown.status.events if e.state == "TURN_TO_GATE")
    said = re.fullmatch(r"gate 1 is off the heading, (\d+) degrees (left|right)", turn.reason)
    assert int(said[1]) == pytest.approx(25, abs=1)
    assert said[2] == ("right" if off > 0 else "left")
    ahead = flown.status.events[states(flown).index("TURN_TO_GATE") + 2]
    assert ahead.state == "HOVER" and ahead.reason.startswith("gate 1 is ahead, 0 degrees")
    assert states(flown)[-1] == "FLY_TO_GATE"
    turning = flown.path[int(turn.time * RATE) : int(ahead.time * RATE)]
    assert np.ptp(turning[:, :2], axis=0).max() < 0.05  # on the spot


@pytest.mark.slow
@pytest.mark.parametrize("off", first([90.0, 180.0, -100.0]))
def test_a_start_that_sees_no_gate_turns_before_it_steps(off):
    track = turned_start(off)
    flown = run(track)
    check_explored(flown, track)
    entered = states(flown)
    assert "LOOK_AROUND" in entered[: entered.index("FLY_TO_GATE")]
    assert not {"STEP_FORWARD", "STEP_AROUND"} & set(entered[: entered.index("FLY_TO_GATE")])


@pytest.mark.repeats
def test_other_gates_that_it_sees_while_turning_are_not_flown():
    """Looking at gates 9 and 10 from the front first."""
    track = turned_start(-120.0)
    flown = run(track)
    check_explored(flown, track)


@pytest.mark.slow
def test_a_lone_marker_is_stepped_around():
    """The left board of gate 1 is hidden until the drone has stepped back."""
    hidden = lambda id, p: id in (0, 1) and p[0] > -0.5  # noqa: E731
    flown = run(REFERENCE, hidden=hidden)
    step = next(e for e in flown.status.events if e.state == "STEP_AROUND")
    assert step.reason == "only marker 2 of gate 1 is in sight"
    check_explored(flown, REFERENCE)


@pytest.mark.slow
def test_steps_around_that_do_not_help_are_followed_by_another_search():
    """The left board shows only from above the pylons."""
    flown = run(REFERENCE, seconds=60.0, hidden=lambda id, p: id == 0 and p[2] < 12.0)
    entered = states(flown)
    assert entered.count("STEP_AROUND") > 1
    assert flown.status.gates[:2] == (0, 1)


@pytest.mark.slow
def test_a_lost_drone_goes_back_above_the_pylons():
    """Gate 6 cannot be read from the height of the boards."""
    hidden = lambda id, p: id // 4 == 5 and p[2] < 10.0  # noqa: E731
    flown = run(REFERENCE, hidden=hidden)
    events = flown.status.events
    (k,) = [k for k, e in enumerate(events) if e.state == "GO_BACK"]
    assert events[k].reason == "lost, back to gate 5"
    assert events[k + 1].reason == "gate 6: both front markers in one image"
    assert flown.status.done and flown.status.gates == tuple(range(10))
    assert clear_of_pylons(flown.path, REFERENCE, RADIUS) > 0.0
    assert flown.path[:, 2].max() < ABOVE_PYLONS + 4.5


@pytest.mark.slow
def test_a_lost_drone_that_is_back_looks_from_above():
    """Gate 6 can be read from above the pylons, but not on the way back."""
    back = []

    def hidden(id, p):
        if id // 4 != 5:
            return False
        if p[2] > 10.0 and not back:
            back.append("on the way")
        elif p[2] < 8.0 and len(back) == 1:
            back.append("there")
        return p[2] < 10.0 or len(back) < 2

    flown = run(REFERENCE, hidden=hidden)
    entered = states(flown)
    assert entered.index("GO_BACK") < entered.index("LOOK_FROM_ABOVE")
    assert flown.status.done and flown.status.gates == tuple(range(10))
    assert clear_of_pylons(flown.path, REFERENCE, RADIUS) > 0.0


@pytest.mark.slow
def test_gate_1_seen_across_the_track_does_not_close_the_loop():
    check_explored(run(REFERENCE, perception=PerceptionConfig(max_range=75.0)), REFERENCE)


@pytest.mark.slow
@pytest.mark.parametrize("turned", first([90.0, 200.0]))
def test_any_heading_of_the_track(turned):
    c, s = np.cos(np.deg2rad(turned)), np.sin(np.deg2rad(turned))
    gates = [
        dc.replace(
            g,
            heading_deg=g.heading_deg + turned,
            left_pylon=[
                c * g.left_pylon[0] - s * g.left_pylon[1],
                s * g.left_pylon[0] + c * g.left_pylon[1],
            ],
        )
        for g in REFERENCE.gates
    ]
    track = dc.replace(REFERENCE, gates=gates, start=Start([0.0, 0.0, 0.0], turned))
    check_explored(run(track), track)


def polygon(n, leg=20.0):
    """A track of n gates, each turned by 360 / n degrees."""
    p, gates = np.array([20.0, 5.0]), []
    for k in range(n):
        heading = 2 * np.pi * k / n
        gates.append(Gate(p.tolist(), np.rad2deg(heading)))
        p = p + leg * np.array([np.cos(heading), np.sin(heading)])
    return Track(f"polygon-{n}", Start([0.0, 0.0, 0.0], 0.0), 5.0, gates)


@pytest.mark.slow
@pytest.mark.parametrize("n", first([6, 7, 8]))
def test_returns_home_clear_of_pylons(n):
    """Gate 1 shows up before the last gates are flown, and they are in the way."""
    track = polygon(n)
    flown = run(track)
    check_explored(flown, track)
    np.testing.assert_allclose(flown.path[-1], [0, 0, 5.1], atol=0.05)


@pytest.mark.repeats
def test_a_ring_that_breaks_the_rule():
    """Six gates on a circle, 60 degrees apart."""
    gates = []
    for k in range(6):
        gate = Gate([0.0, 0.0], 60.0 * k)
        x, y = 25.0 * gate.rightward[:2]
        gate.left_pylon = [x - 5.0 * gate.rightward[0], y - 5.0 * gate.rightward[1]]
        gates.append(gate)
    track = Track("ring", Start([-20.0, -25.0, 0.0], 0.0), 5.0, gates)
    flown = run(track)
    check_explored(flown, track)
    assert flown.status.closed_at < 60.0


def standing(estimate, seconds):
    """Returns the explorer's status and reference after sitting still with one estimate."""
    explorer = Explorer(config=ExplorerConfig(), hover_height=5.0, clearance=CLEARANCE)
    simulator = Simulator(explorer)
    context = simulator.get_mutable_context()
    explorer.GetInputPort("detections").FixValue(context, Value[object](Detections()))
    explorer.GetInputPort("gate_map").FixValue(context, Value[object](GateMap()))
    port = explorer.GetInputPort("state_estimate")
    for value, time in zip(np.atleast_2d(estimate), np.atleast_1d(seconds)):
        port.FixValue(context, value)
        simulator.AdvanceTo(time)
    return (
        explorer.GetOutputPort("explorer_status").Eval(context),
        explorer.GetOutputPort("exploration_reference").Eval(context),
    )


def on_pad(tilt_deg, v=0.0):
    q = RollPitchYaw(np.deg2rad(tilt_deg), 0, 0.3).ToQuaternion().wxyz()
    return np.array([0, *q, 1, 2, 0.1, 0, 0, 0, v, 0, 0], float)


def test_stays_on_a_pad_that_is_too_steep_and_says_so():
    status, reference = standing(on_pad(20), 3.0)
    assert status.state == "CALIBRATE"
    assert status.reason == "tilted by 20 degrees, more than 15: staying"
    assert len(status.events) == 2
    np.testing.assert_allclose(reference[:3], [1, 2, 0.1])
    assert as_reference(reference).acceleration[2] < NO_LIFT  # the rotors idle


def test_takes_off_once_it_is_level_and_at_rest():
    status, _ = standing([on_pad(20), on_pad(8, v=1.0), on_pad(8)], [1.0, 2.0, 4.0])
    assert [event.reason.split()[0] for event in status.events] == [
        "power",
        "tilted",
        "moving,",
        "level",
        "level",
    ]
    assert status.state == "TAKE_OFF" and status.since == pytest.approx(2.5)
    assert status.reason == "level within 8.0 degrees, taking off"


def test_takes_off_straight_up_along_its_heading():
    status, reference = standing(on_pad(0), 6.0)
    assert status.state == "TAKE_OFF"  # the estimate never arrives
    np.testing.assert_allclose(reference[:3], [1, 2, 5.1], atol=1e-6)
    assert reference[15] == pytest.approx(0.3)


def test_a_drone_that_does_not_rise_gives_up():
    status, _ = standing(on_pad(0), 30.0)
    assert status.state == "LAND"
    assert status.reason.startswith("it is 0.0 m above its pad 20 s after it should hover at 5.0 m")


def test_a_scenario_can_ask_for_a_slower_exploration():
    scenario = Scenario(explorer=ExplorerConfig(max_speed=4.0))
    flown = explore(
        make_explorer(REFERENCE, scenario), ExplorationWorld(REFERENCE), REFERENCE, 20.0
    )
    speed = np.linalg.norm(np.diff(flown.path, axis=0), axis=1) * RATE
    assert 3.0 < np.quantile(speed, 0.9) < 4.1
