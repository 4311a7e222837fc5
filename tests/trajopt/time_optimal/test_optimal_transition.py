"""Transitions onto a time-optimal lap: without a jump, within the limits, and quick."""

import dataclasses as dc
import functools

import numpy as np
import pytest

from airrace.track import load_track
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.feasibility import check_flight, passes_forward, pylon_distances, sample_times
from airrace.trajopt.flight_limits import FlightConstraints, FlightLimits
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.min_snap.transition import plan_transition_from_hover
from airrace.trajopt.reference import as_reference
from airrace.trajopt.time_optimal.optimal_lap import plan_optimal_circuit
from airrace.trajopt.time_optimal.optimal_transition import plan_optimal_transition
from airrace.vehicle import load_vehicle
from tests.worlds.cases import first

TRACK, VEHICLE = load_track("student-airrace"), load_vehicle("Default")[0]
MIDPOINTS = np.array([gate.p_WG for gate in TRACK.gates])
HEADINGS = np.array([gate.heading for gate in TRACK.gates])
PYLONS, CLEARANCE = TRACK.pylons()[:, :2], 1.9
LIMITS = {
    "original": FlightLimits(VEHICLE, thrust_share=0.9, max_speed=20.0, max_acceleration=10.0),
    "rotor": FlightLimits(VEHICLE, thrust_share=0.9),
}
each = pytest.mark.parametrize("limits", LIMITS)


def windows(step=0.0):
    return GateRegions.windows(MIDPOINTS + step, HEADINGS, 5.0 - CLEARANCE, 2.5)


@functools.cache
def lap(limits, seed=None):
    """Returns a lap through the gates, or through gates some 10 cm elsewhere, and these."""
    step = (
        0.0
        if seed is None
        else np.random.default_rng(seed).normal(scale=0.06, size=MIDPOINTS.shape)
    )
    gates = windows(step)
    return plan_optimal_circuit(
        gates,
        FlightConstraints(PYLONS, CLEARANCE, LIMITS[limits].scaled(0.99)),
        previous=None if seed is None else lap(limits)[0],
    ), gates


def hover(x=0.0, y=0.0, z=5.0, yaw=0.0):
    result = np.zeros((5, 4))
    result[0] = x, y, z, yaw
    return result


def transition(start, first, k, limits, circuit, gates, **options):
    legs = np.diff(circuit.gate_times)[: k - 1]
    return plan_optimal_transition(
        start,
        [first, *legs],
        gates,
        circuit,
        FlightConstraints(PYLONS, CLEARANCE, LIMITS[limits]),
        **options,
    )


def assert_sound(found, phase, start, circuit, gates, k, limits):
    """Checks both ends, the limits at 1 kHz, the room, and the gates on the way."""
    for ours, theirs in (
        (found.derivatives(0.0), start),
        (found.derivatives(found.duration), circuit.derivatives(phase)),
    ):
        np.testing.assert_allclose(ours[:, :3], theirs[:, :3], atol=1e-6)
        assert np.cos(ours[0, 3] - theirs[0, 3]) == pytest.approx(1.0, abs=1e-12)
        np.testing.assert_allclose(ours[1:3, 3], theirs[1:3, 3], atol=1e-6)
    for t in found.breaks[1:-1]:
        jump = found.derivatives(t + 1e-9) - found.derivatives(t - 1e-9)
        np.testing.assert_allclose(jump[:4, :3], 0.0, atol=1e-4)
        np.testing.assert_allclose(jump[:3, 3], 0.0, atol=1e-4)
    samples = found.sample(sample_times(found, 1000.0))
    assert check_flight(samples, PYLONS, LIMITS[limits]).excess <= 0.0
    assert pylon_distances(samples, PYLONS).min() > CLEARANCE - 0.06
    assert samples[2].min() > 0.94
    for i in range(k - 1):
        ahead = (as_reference(samples).position.T - gates.midpoints[i]) @ gates.forward[i]
        at = np.flatnonzero((ahead[:-1] < 0.0) & (ahead[1:] >= 0.0))
        missed = [
            np.linalg.norm(
                gates.nearest(np.tile(samples[:3, j], (len(gates.midpoints), 1)))[i]
                - samples[:3, j]
            )
            for j in at
        ]
        assert min(missed) < 0.05
        times = sample_times(found, 1000.0)[at[int(np.argmin(missed))]]
        assert passes_forward(found, [times], gates.headings[i : i + 1]).all()


@pytest.mark.slow
@each
@pytest.mark.parametrize("k", first([2, 3]))
def test_from_hover(limits, k):
    circuit, gates = lap(limits)
    found, phase = transition(hover(), 2.0, k, limits, circuit, gates)
    assert phase == circuit.gate_times[k - 1]
    assert_sound(found, phase, hover(), circuit, gates, k, limits)


def test_it_is_quicker_than_minimum_snap():
    circuit, gates = lap("original")
    found, phase = transition(hover(), 2.0, 3, "original", circuit, gates)
    snap, joined = plan_transition_from_hover(
        hover(), circuit, 4, FlightConstraints(PYLONS, CLEARANCE, LIMITS["original"])
    )
    assert found.duration - phase < 0.9 * (snap.duration - joined)
    # Nothing gets 20 m from rest to gate 1 in less than 2 s, nor to 20 m/s.
    assert found.duration - phase > 1.9


@functools.cache
def lap_at_the_limits():
    """Returns a lap that keeps hardly less than all of the limits."""
    limits = LIMITS["original"]
    limits = dc.replace(
        limits,
        max_speed=0.9998 * limits.max_speed,
        max_acceleration=0.998 * limits.max_acceleration,
    )
    gates = windows()
    return plan_optimal_circuit(gates, FlightConstraints(PYLONS, CLEARANCE, limits)), gates


def test_a_lap_at_the_limits_is_joined():
    circuit, gates = lap_at_the_limits()
    found, phase = transition(hover(), 2.0, 3, "original", circuit, gates)
    assert_sound(found, phase, hover(), circuit, gates, 3, "original")
    assert found.duration - phase < 2.45


def test_what_is_left_of_a_lap_at_the_limits_takes_no_longer():
    circuit, gates = lap_at_the_limits()
    at = circuit.gate_times[-2] + 0.02
    start, left = circuit.derivatives(at), circuit.duration - at
    found, phase = transition(
        start, left, 2, "original", circuit, gates, old=lambda time: circuit.derivatives(at + time)
    )
    assert_sound(found, phase, start, circuit, gates, 2, "original")
    assert found.duration - phase - left < 0.002


def test_a_turned_drone_turns_on_the_way():
    circuit, gates = lap("original")
    start = hover(-10.0, 3.0, 4.0, 0.8)
    found, phase = transition(start, 3.0, 2, "original", circuit, gates)
    assert_sound(found, phase, start, circuit, gates, 2, "original")


@pytest.mark.slow
@each
@pytest.mark.parametrize("seed", first(range(2)))
@pytest.mark.parametrize("known", [False, True])
def test_from_the_lap_before(limits, seed, known):
    (lap_before, _), (new, gates) = lap(limits), lap(limits, seed)
    at = lap_before.gate_times[-2] + 0.02
    start, left = lap_before.derivatives(at), lap_before.duration - at
    old = (lambda time: lap_before.derivatives(at + time)) if known else None
    found, phase = transition(start, left, 2, limits, new, gates, old=old)
    assert_sound(found, phase, start, new, gates, 2, limits)
    # It costs next to nothing.
    assert abs(found.duration - phase - left) < 0.1


def test_the_same_input_gives_the_same_transition():
    circuit, gates = lap("original")
    one, other = (transition(hover(), 2.0, 2, "original", circuit, gates)[0] for _ in range(2))
    times = np.linspace(0.0, one.duration, 50)
    np.testing.assert_array_equal(one.sample(times), other.sample(times))


@pytest.mark.parametrize(
    "fault, words",
    [("a wall", "."), ("too far too late", "limits"), ("a gate from the side", "sideways")],
)
def test_none_is_one_clear_error(fault, words):
    circuit, gates = lap("original")
    start, pylons, first_leg = hover(), PYLONS, 1.0
    if fault == "a wall":
        pylons = np.vstack([PYLONS, [[10.0, y] for y in range(-60, 61, 2)]])
    elif fault == "too far too late":  # at full speed towards a place beside the gate
        start = hover(17.0, 4.0)
        start[1, :3] = 0.0, 20.0, 0.0
    else:
        turned, first_leg = HEADINGS + [1.4, *[0.0] * (len(HEADINGS) - 1)], 2.0
        gates = GateRegions.windows(MIDPOINTS, turned, 5.0 - CLEARANCE, 2.5)
    with pytest.raises(TrajectoryOptimizationError, match=words):
        plan_optimal_transition(
            start,
            [first_leg, circuit.gate_times[1]],
            gates,
            circuit,
            FlightConstraints(pylons, CLEARANCE, LIMITS["original"]),
        )
