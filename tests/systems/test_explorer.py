import dataclasses as dc

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.math import RollPitchYaw
from pydrake.systems.analysis import Simulator

from airrace.diagrams.scenario import ExplorerConfig
from airrace.systems.explorer import Explorer
from airrace.systems.types import Detections, GateMap
from airrace.track import Gate, Start, Track, load_track
from tests.systems.kinematic_world import KinematicWorld, explore

REFERENCE = load_track("student-airrace")
CLEARANCE = 2.0


def run(track, config=ExplorerConfig(), **kwargs):
    explorer = Explorer(config=config, hover_height=track.hover_height, clearance=CLEARANCE)
    return explore(explorer, KinematicWorld(track, **kwargs))


@pytest.fixture(scope="module")
def reference_run():
    return run(REFERENCE)


def test_finds_all_gates_of_the_reference_track_in_order(reference_run):
    statuses, _ = reference_run
    assert statuses[-1].done
    assert statuses[-1].gates == tuple(range(10))
    assert statuses[-1].closed_at < 80.0


def test_states_follow_the_flow_chart(reference_run):
    statuses, _ = reference_run
    states = [s.state for s in statuses]
    assert states[:3] == ["CALIBRATE", "TAKE_OFF", "FLY_TO_GATE"] or states[:4] == [
        "CALIBRATE", "TAKE_OFF", "HOVER", "FLY_TO_GATE"]
    assert states[-2:] == ["RETURN", "DONE"]
    assert "STEP_FORWARD" in states  # gate 6 is 70 m beyond gate 5
    assert all(s.reason for s in statuses)
    times = [s.since for s in statuses]
    assert times == sorted(times)


def test_flies_through_every_gate_in_order_and_clear_of_pylons(reference_run):
    _, path = reference_run
    crossed = []
    for before, after in zip(path[:, :3], path[1:, :3]):
        for i, gate in enumerate(REFERENCE.gates):
            d0, d1 = (before - gate.p_WG) @ gate.forward, (after - gate.p_WG) @ gate.forward
            at = before + d0 / (d0 - d1) * (after - before) if d0 < 0 <= d1 else None
            if at is not None and abs((at - gate.p_WG) @ gate.rightward) < 5:
                crossed.append(i)
    assert crossed == list(range(10))
    distance = np.linalg.norm(path[:, None, :2] - REFERENCE.pylons()[None, :, :2], axis=2)
    assert distance.min() > 2.0
    assert path[20:, 2].min() > 0.0


def test_legs_keep_to_the_limits(reference_run):
    _, path = reference_run
    velocity = np.diff(path[:, :3], axis=0) * 20.0
    assert np.linalg.norm(velocity, axis=1).max() < 1.3 * ExplorerConfig().max_speed


def test_ends_hovering_over_the_start(reference_run):
    _, path = reference_run
    np.testing.assert_allclose(path[-1, :3], [0, 0, 5.1], atol=0.05)
    assert np.cos(path[-1, 3]) == pytest.approx(1.0)


def test_does_not_stop_between_gates_in_sight():
    """From take-off to gate 4, each next gate shows before the last is passed."""
    statuses, path = run(REFERENCE, sight=45.0)
    first = next(s.since for s in statuses if s.state == "FLY_TO_GATE")
    last = next(s.since for s in statuses if len(s.gates) == 4)
    speed = np.linalg.norm(np.diff(path[:, :3], axis=0), axis=1) * 20.0
    assert speed[int((first + 2) * 20):int(last * 20)].min() > 1.0


def test_a_lone_right_marker_is_stepped_around():
    """The left board of gate 1 is hidden until the drone has stepped back."""
    statuses, _ = run(REFERENCE, hidden=lambda id, pose: id == 0 and pose[0] > -0.5)
    step = next(s for s in statuses if s.state == "STEP_AROUND")
    assert step.reason == "only marker 2 of gate 1 in sight"
    assert statuses[-1].gates == tuple(range(10))


def test_a_step_around_that_does_not_help_is_followed_by_another_search():
    """The left board shows only from near."""
    statuses, _ = run(REFERENCE, hidden=lambda id, pose: id == 0 and pose[0] < 5.0)
    states = [s.state for s in statuses]
    assert states.index("STEP_AROUND") < states.index("STEP_FORWARD")
    assert statuses[-1].gates == tuple(range(10))


def test_gate_1_seen_across_the_track_does_not_close_the_loop():
    statuses, _ = run(REFERENCE, sight=75.0)
    assert statuses[-1].gates == tuple(range(10))


@pytest.mark.parametrize("turned", [0.0, 90.0, 200.0])
def test_any_heading_of_the_track(turned):
    c, s = np.cos(np.deg2rad(turned)), np.sin(np.deg2rad(turned))
    gates = [
        dc.replace(g, heading_deg=g.heading_deg + turned, left_pylon=[
            c * g.left_pylon[0] - s * g.left_pylon[1],
            s * g.left_pylon[0] + c * g.left_pylon[1]])
        for g in REFERENCE.gates
    ]
    track = dc.replace(REFERENCE, gates=gates, start=Start([0.0, 0.0, 0.0], turned))
    statuses, path = run(track)
    assert statuses[-1].gates == tuple(range(10))
    assert (path[-1, 3] - np.deg2rad(turned) + np.pi) % (2 * np.pi) == pytest.approx(np.pi)


def polygon(n, leg=20.0):
    """A track of n gates, each turned by 360 / n degrees, by the layout rule."""
    p, gates = np.array([20.0, 5.0]), []
    for k in range(n):
        heading = 2 * np.pi * k / n
        gates.append(Gate(p.tolist(), np.rad2deg(heading)))
        p = p + leg * np.array([np.cos(heading), np.sin(heading)])
    return Track(f"polygon-{n}", Start([0.0, 0.0, 0.0], 0.0), 5.0, gates)


@pytest.mark.parametrize("n", [7, 8])
def test_returns_home_clear_of_pylons(n):
    """Gate 1 shows up before the last gates are flown, and they are in the way."""
    track = polygon(n)
    statuses, path = run(track)
    assert statuses[-1].done and statuses[-1].gates == tuple(range(n))
    beside = np.linalg.norm(path[:, None, :2] - track.pylons()[None, :, :2], axis=2)
    assert np.hypot(beside, np.maximum(path[:, None, 2] - 12.0, 0)).min() > 1.9
    np.testing.assert_allclose(path[-1, :3], [0, 0, 5.1], atol=0.05)


def still(estimate, seconds):
    """Returns the explorer's status after sitting still with one estimate."""
    explorer = Explorer(config=ExplorerConfig(), hover_height=5.0, clearance=CLEARANCE)
    simulator = Simulator(explorer)
    context = simulator.get_mutable_context()
    explorer.GetInputPort("detections").FixValue(context, Value[object](Detections()))
    explorer.GetInputPort("gate_map").FixValue(context, Value[object](GateMap()))
    explorer.GetInputPort("state_estimate").FixValue(context, estimate)
    simulator.AdvanceTo(seconds)
    return (
        explorer.GetOutputPort("explorer_status").Eval(context),
        explorer.GetOutputPort("exploration_reference").Eval(context),
    )


def test_does_not_take_off_while_tilted():
    tilted = RollPitchYaw(np.deg2rad(20), 0, 0.3).ToQuaternion().wxyz()
    status, reference = still([0, *tilted, 1, 2, 0.1, *np.zeros(6)], 3.0)
    assert status.state == "CALIBRATE"
    np.testing.assert_allclose(reference[:3], [1, 2, 0.1])


def test_takes_off_straight_up_along_its_heading():
    q = RollPitchYaw(0, 0, 0.3).ToQuaternion().wxyz()
    status, reference = still([0, *q, 1, 2, 0.1, *np.zeros(6)], 6.0)
    assert status.state == "TAKE_OFF"  # the estimate never arrives
    np.testing.assert_allclose(reference[:3], [1, 2, 5.1], atol=1e-6)
    assert reference[15] == pytest.approx(0.3)
