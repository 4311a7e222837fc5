"""What a step predicts of the lap after it, to first order."""

import numpy as np
import pytest

from airrace.trajopt.flat_trajectory import pack
from airrace.trajopt.flight_limits import FlightLimits
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.time_optimal.dynamics import LinearDynamics, angle_dynamics
from airrace.trajopt.time_optimal.lap_samples import Grid, LapSamples, slowed
from airrace.trajopt.time_optimal.lap_spline import LapSpline
from airrace.trajopt.time_optimal.lap_step import LapStep
from airrace.trajopt.time_optimal.visibility import keep_in_view
from airrace.vehicle import RACERS, load_vehicle

GRID, TURN = Grid(6, 12), 2 * np.pi
LIMITS = {drone: FlightLimits(load_vehicle(drone)[0]) for drone in RACERS}


def samples(limits, seed=0):
    rng = np.random.default_rng(seed)
    angle = np.pi / 2 * np.arange(4)
    out = np.column_stack([np.sin(angle), -np.cos(angle), np.zeros(4)])
    forward = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(4)])
    v = np.repeat(10.0 * forward[:, None], 30, axis=1)
    places = 15 * out + [0, 0, 6] + rng.normal(size=(4, 3))
    lap = LapSpline.through(places, v, rng.uniform(1.7, 2.3, 4), 6, 1e-4 / 2.0**6)
    return slowed(lap, GRID, limits, TURN)


@pytest.mark.parametrize("drone", LIMITS)
def test_gradients_of_the_dynamics(drone):
    now = samples(LIMITS[drone])
    rows = LinearDynamics.linearize(now)
    rng = np.random.default_rng(1)
    y = now.derivatives.reshape(5, -1, 4)
    # The angle's third and fourth derivatives do not matter, nor does the place.
    change, change_T = rng.normal(size=y.shape), rng.normal(size=len(now.units))
    change[3:, :, 3] = change[0, :, :3] = 0.0

    def after(h):
        thrusts, force, w, _ = angle_dynamics(
            pack(y + h * change), now.units + h * change_T, now.axes, now.limits
        )
        vehicle = now.limits.vehicle
        share = np.linalg.pinv(vehicle.allocation)[:, :1] * vehicle.mass
        rest = thrusts - share * np.linalg.norm(force, axis=0)
        return force, rest, np.linalg.norm(w, axis=0), w

    h = 1e-6
    for i, (_, d, by_T) in enumerate(rows):
        expected = (after(h)[i] - after(-h)[i]) / (2 * h)
        found = np.einsum("rnod,ond->rn", d, change) + by_T * change_T
        np.testing.assert_allclose(
            found.reshape(expected.shape), expected, atol=1e-5 * np.abs(expected).max()
        )


@pytest.mark.parametrize("drone", LIMITS)
@pytest.mark.parametrize("quantity", ["force", "rest"])
def test_rows_say_what_a_step_does(drone, quantity):
    """The error of what rows predict falls with the square of the step."""
    now = samples(LIMITS[drone])
    errors = []
    for size in (3e-2, 3e-3):
        step = LapStep(now, GRID)
        rng = np.random.default_rng(2)
        for leg in range(4):  # somewhere
            wish = rng.normal(size=step.size(leg))
            step.least_squares(leg, 1e3 * np.eye(len(wish)), -1e3 * size * wish)
        values, rows, by_T = getattr(step.dynamics, quantity)
        new, predicted = step.solve(), []
        for leg in range(4):
            here, x = step.of(leg), step.result.GetSolution(step._variables[leg])
            r = step.rows(leg, np.arange(GRID.samples), rows[0, here], by_T[0, here])
            predicted.append(r @ x + values[0, here])
        predicted = np.concatenate(predicted)
        after = LinearDynamics.linearize(LapSamples.of(new, GRID, now.limits, TURN))
        found = getattr(after, quantity).values[0]
        assert np.linalg.norm(predicted - values[0]) > size
        errors.append(np.linalg.norm(found - predicted))
    assert errors[1] < 0.03 * errors[0]


def test_only_samples_near_a_bound_of_the_view_are_kept_in_it(monkeypatch):
    now = samples(LIMITS["Default"])
    gates = GateRegions.windows(
        now.lap.gates[:, 0, :3], np.pi / 2 * np.arange(4), np.full(4, 2.0), 1.0
    )
    found = {}
    for band in (np.inf, 0.3):
        found[band] = []
        monkeypatch.setattr(
            LapStep,
            "at_most",
            lambda step, leg, rows, room, **k: found[band].extend(zip(rows.tolist(), room)),
        )
        keep_in_view(LapStep(now, GRID), gates, np.deg2rad(40.0), 1.0, band)
    assert found[0.3] == [each for each in found[np.inf] if each[1] < 0.3]
    assert 0 < len(found[0.3]) < len(found[np.inf]) / 2
