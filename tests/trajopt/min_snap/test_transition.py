"""Transitions onto a lap: without a jump, forward, and within the limits."""

import functools
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from airrace.track import PYLON_HEIGHT, load_track
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.flight_limits import FlightConstraints, FlightLimits
from airrace.trajopt.min_snap.circuit import plan_circuit
from airrace.trajopt.min_snap.transition import (
    plan_transition_between_laps,
    plan_transition_from_hover,
)
from airrace.trajopt.reference import as_reference
from airrace.vehicle import load_vehicle
from tests.worlds.cases import first

TRACK = load_track("student-airrace")
MIDPOINTS = np.array([gate.p_WG for gate in TRACK.gates])
HEADINGS = np.array([gate.heading for gate in TRACK.gates])
PYLONS = TRACK.pylons()[:, :2]
LIMITS = dict(
    clearance=2.0,
    limits=FlightLimits(load_vehicle("Default")[0], max_speed=20.0, max_acceleration=10.0),
)
CONSTRAINTS = FlightConstraints(PYLONS, **LIMITS)
each = pytest.mark.parametrize("dimensions", [3, 4, 6])
few = settings(max_examples=12)


def pylons_of(midpoints, headings):
    right = 5.0 * np.column_stack([np.sin(headings), -np.cos(headings)])
    return np.vstack([midpoints[:, :2] - right, midpoints[:, :2] + right])


@functools.cache
def reference(dimensions):
    return plan_circuit(MIDPOINTS, HEADINGS, dimensions, CONSTRAINTS)


@functools.cache
def moved(dimensions, seed, distance=0.3):
    """Returns the lap through gates that are somewhat elsewhere, and its pylons."""
    rng = np.random.default_rng(seed)
    step = rng.normal(size=MIDPOINTS.shape)
    step *= distance / np.linalg.norm(step, axis=1, keepdims=True)
    midpoints, headings = MIDPOINTS + step, HEADINGS + rng.normal(scale=0.03, size=len(HEADINGS))
    pylons = pylons_of(midpoints, headings)
    return plan_circuit(
        midpoints,
        headings,
        dimensions,
        FlightConstraints(pylons, **LIMITS),
        previous=reference(dimensions),
    ), pylons


def assert_same(ours, theirs, tolerances):
    """Compares states, (k, 4), but for full turns of yaw."""
    for order, tolerance in enumerate(tolerances):
        np.testing.assert_allclose(ours[order, :3], theirs[order, :3], atol=tolerance)
    assert np.cos(ours[0, 3] - theirs[0, 3]) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(
        ours[1 : len(tolerances), 3], theirs[1 : len(tolerances), 3], atol=max(tolerances)
    )


def assert_feasible(trajectory, pylons=PYLONS):
    times = np.linspace(0, trajectory.duration, int(1000 * trajectory.duration))
    samples = trajectory.sample(times)
    # Between the samples of the planner's own check, peaks may be a bit higher.
    assert np.linalg.norm(as_reference(samples).velocity, axis=0).max() <= 20.0 * (1 + 1e-4)
    assert np.linalg.norm(as_reference(samples).acceleration, axis=0).max() <= 10.0 * (1 + 1e-4)
    assert 0.99 < samples[2].min() and samples[2].max() < PYLON_HEIGHT
    assert np.linalg.norm(samples[:2, :, None] - pylons.T[:, None], axis=0).min() > 1.99


def hover(x, y, z, yaw):
    result = np.zeros((5, 4))
    result[0] = x, y, z, yaw
    return result


def crossings(trajectory, gate):
    """Returns the signs of all crossings of a gate between its pylons."""
    times = np.linspace(0, trajectory.duration, int(1000 * trajectory.duration))
    p = trajectory.sample(times)[:3].T - gate.p_WG
    ahead, side = p @ gate.forward, p @ gate.rightward
    step = np.flatnonzero(np.diff(np.sign(ahead)))
    return [np.sign(ahead[i + 1] - ahead[i]) for i in step if abs(side[i]) < gate.pylon_spacing / 2]


STARTS = {
    "the start": (0, 0, 5, 0),
    "facing back": (0, 0, 5, -3),
    "facing right, two turns on": (0, 0, 5, -np.pi / 2 + 4 * np.pi),
    "high": (0, 0, 11, 0),
    "low and aside": (-10, 20, 3, 1),
    "far": (-60, 0, 5, 0),
    "near gate 1": (17, 0, 5, 0),
    "below gate 1": (20, 0, 5, 0),
    "in gate 1": (20, 0, 6.25, 0),
    "just through gate 1": (20.1, 0, 6.25, 0),
    "behind gate 1": (27, 0, 5, 0),
    "behind a pylon": (30, 20, 5, 0),
    "beside gate 1": (20, -15, 5, 2),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", STARTS)
@pytest.mark.parametrize("dimensions", first([3, 6]))
def test_start(name, dimensions):
    circuit, start = reference(dimensions), hover(*STARTS[name])
    clock = time.process_time()
    entry, phase = plan_transition_from_hover(start, circuit, dimensions, CONSTRAINTS)
    assert time.process_time() - clock < 10.0
    assert_same(entry.derivatives(0.0), start, 4 * [1e-8])
    assert_same(entry.derivatives(entry.duration), circuit.derivatives(phase), 4 * [1e-7])
    for t in entry.breaks[1:-1]:
        assert_same(entry.derivatives(t - 1e-9), entry.derivatives(t + 1e-9), 5 * [1e-5])
    assert_feasible(entry)
    # It joins at a gate, and has passed all before, the first one included, forward.
    joined = circuit.gate_times.index(phase)
    assert 1 <= joined <= 3
    for i in range(joined):
        passing = [
            d
            for d in map(entry.derivatives, entry.breaks)
            if np.allclose(d[0, :3], MIDPOINTS[i], atol=1e-7)
        ][-1]
        v = passing[1, :3]
        assert v @ TRACK.gates[i].forward > 0.5 * np.linalg.norm(v)
        assert crossings(entry, TRACK.gates[i])[-1] == 1
        if dimensions == 6:
            np.testing.assert_allclose(passing[2, :2], 0.0, atol=1e-7)


def test_start_in_four_dimensions_turns_with_the_gates():
    circuit = reference(4)
    entry, phase = plan_transition_from_hover(hover(0, 0, 5, -1), circuit, 4, CONSTRAINTS)
    for i in range(circuit.gate_times.index(phase)):
        yaw = entry.derivatives(entry.breaks[1 + i])[0, 3]
        assert np.cos(yaw - HEADINGS[i]) == pytest.approx(1.0)
    yaw = [entry.derivatives(t)[0, 3] for t in entry.breaks]
    assert np.abs(np.diff(yaw)).max() < np.pi


@each
def test_the_start_is_quick(dimensions):
    """From rest at 20 m to gate 1 it loses little on a flying start."""
    circuit = reference(dimensions)
    entry, phase = plan_transition_from_hover(hover(0, 0, 5, 0), circuit, dimensions, CONSTRAINTS)
    # At the limit of acceleration, gate 1 is 2 s away, at full speed 1 s.
    assert 1.5 < entry.duration - phase < 2.5


def test_start_onto_a_lap_with_a_waypoint_in_front_of_a_gate():
    """The entry takes that waypoint, too; the gate asks for it."""
    headings = np.pi / 2 * np.arange(4)
    out = np.column_stack([np.sin(headings), -np.cos(headings), np.zeros(4)])
    midpoints = 20 * out + [0.0, 0.0, 6.0]
    for turned in (0, 1, 2):
        askew = headings.copy()
        askew[turned] += 1.4
        pylons = pylons_of(midpoints, askew)
        circuit = plan_circuit(midpoints, askew, 4, FlightConstraints(pylons, **LIMITS))
        assert turned in circuit.approach
        entry, phase = plan_transition_from_hover(
            hover(-25, -30, 5, 0), circuit, 4, FlightConstraints(pylons, **LIMITS)
        )
        assert_same(entry.derivatives(entry.duration), circuit.derivatives(phase), 4 * [1e-7])
        assert_feasible(entry, pylons)


def test_no_start_from_among_pylons():
    wall = [[10, y] for y in range(-60, 61, 2)] + [[-10, y] for y in range(-60, 61, 2)]
    clock = time.process_time()
    with pytest.raises(TrajectoryOptimizationError):
        plan_transition_from_hover(
            hover(0, 0, 5, 0), reference(3), 3, FlightConstraints([*PYLONS, *wall], **LIMITS)
        )
    assert time.process_time() - clock < 20.0


@few
@given(st.sampled_from([3, 4, 6]), st.floats(0.0, 0.95))
def test_a_change_to_the_same_lap_is_its_last_leg(dimensions, late):
    circuit = reference(dimensions)
    start = circuit.gate_times[-2] + late * (circuit.duration - circuit.gate_times[-2])
    change = plan_transition_between_laps(
        circuit.derivatives(start), circuit, circuit.duration - start, CONSTRAINTS
    )
    assert change.duration == pytest.approx(circuit.duration - start, abs=1e-12)
    for t in np.linspace(0.0, change.duration, 20):
        # Once the lap's waypoint in front of gate 1 is behind, so is its corner in snap.
        assert_same(change.derivatives(t), circuit.derivatives(start + t), (1e-3, 1e-2, 0.05, 0.5))


@each
@pytest.mark.parametrize("seed", range(3))
def test_a_change_to_a_moved_lap(dimensions, seed):
    old, (new, pylons) = reference(dimensions), moved(dimensions, seed)
    for late in (0.0, 0.05, 0.3):
        at = old.gate_times[-2] + late
        start, duration = old.derivatives(at), old.duration - at
        change = plan_transition_between_laps(
            start, new, duration, FlightConstraints(pylons, **LIMITS)
        )
        assert_same(change.derivatives(0.0), start, 5 * [1e-7])
        end = change.derivatives(change.duration)
        assert_same(end, new.derivatives(0.0), (1e-7, 1e-7, 1e-7, 1e-6, 1e-5))
        for t in change.breaks[1:-1]:
            assert_same(change.derivatives(t - 1e-9), change.derivatives(t + 1e-9), 5 * [1e-5])
        assert_feasible(change, pylons)
        assert duration - 1e-9 <= change.duration <= 1.05 * duration
        # Nothing is left of the old lap, and the way there did not wander off.
        yaw = change.derivatives(change.duration)[0, 3] - start[0, 3]
        assert abs(yaw) < np.pi


@few
@given(st.integers(-3, 3))
def test_a_change_does_not_unwind_yaw(turns):
    circuit = reference(4)
    at = circuit.gate_times[-2]
    start = circuit.derivatives(at)
    start[0, 3] += 2 * np.pi * turns
    change = plan_transition_between_laps(start, circuit, circuit.duration - at, CONSTRAINTS)
    assert change.derivatives(change.duration)[0, 3] == pytest.approx(2 * np.pi * (turns + 1))


@each
@pytest.mark.parametrize("left", [0.0, 1e-9, 0.05, 0.11, 0.3])
def test_too_late_for_a_change(dimensions, left):
    """Hardly any time is left to get 3 m aside: the old lap must go on."""
    old, (new, pylons) = reference(dimensions), moved(dimensions, 0, 3.0)
    start = old.derivatives(old.duration - left)
    with pytest.raises(TrajectoryOptimizationError):
        plan_transition_between_laps(start, new, left, FlightConstraints(pylons, **LIMITS))


def test_a_change_keeps_clear_of_pylons():
    circuit = reference(3)
    at = circuit.gate_times[-2]
    start, duration = circuit.derivatives(at), circuit.duration - at
    inside = circuit.derivatives(at + duration / 2)[0, :2]
    with pytest.raises(TrajectoryOptimizationError):
        plan_transition_between_laps(
            start, circuit, duration, FlightConstraints([*PYLONS, inside], **LIMITS)
        )
