"""The thrust-axis angle instead of yaw: axes that do not turn, and the yaw that comes of it."""

import numpy as np
import pytest

from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.flatness import attitude_from_force, heading_vectors, inverse_dynamics
from airrace.trajopt.flight_limits import FlightLimits
from airrace.trajopt.reference import as_reference
from airrace.trajopt.time_optimal.dynamics import angle_dynamics
from airrace.trajopt.time_optimal.lap_samples import Grid, LapSamples
from airrace.trajopt.time_optimal.lap_spline import LapSpline
from airrace.trajopt.time_optimal.optimal_circuit import flat_polynomial
from airrace.trajopt.time_optimal.thrust_axis_angle import yaw_of_attitude
from airrace.vehicle import load_vehicle

LIMITS = [FlightLimits(load_vehicle("Default")[0]), FlightLimits(load_vehicle("StarOne")[0])]
TURN = 2 * np.pi


def loop():
    """Returns a lap round a square, fast enough to lean, with some thrust-axis angle."""
    angle = np.pi / 2 * np.arange(4)
    forward = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(4)])
    out = np.column_stack([np.sin(angle), -np.cos(angle), np.zeros(4)])
    v = np.repeat(11.0 * forward[:, None], 30, axis=1)
    lap = LapSpline.through(15 * out + [0, 0, 6], v, np.full(4, 2.0), 6, 1e-4 / 2.0**6)
    gates = lap.gates.copy()
    gates[:, 0, 3], gates[:, 1, 3] = [0.1, 1.4, 3.3, 4.6], 0.7
    return LapSpline(gates, lap.interior, lap.durations, 0.0)


@pytest.mark.parametrize("limits", LIMITS)
def test_axes_do_not_turn_about_the_thrust_and_close_with_the_lap(limits):
    grid = Grid(6, 400)
    samples = LapSamples.of(loop(), grid, limits, TURN)
    x, y = samples.axes
    middle = (y[:, 1:] + y[:, :-1]) / 2
    turns = np.sum((x[:, 1:] - x[:, :-1]) * middle, axis=0)
    lean = np.arccos(np.cross(x, y, axis=0)[2])
    assert lean.max() > 0.5  # else it would be easy
    assert np.abs(turns).max() < 1e-6
    # At the end the body is as it was at the start.
    angle = samples.derivatives[0, ..., 3].ravel()
    body = np.cos(angle) * x + np.sin(angle) * y
    np.testing.assert_allclose(body[:, -1], body[:, 0], atol=0.1)
    assert (
        abs(
            np.sum((body[:, 0] - body[:, -1]) * y[:, 0])
            - np.sum((body[:, -1] - body[:, -2]) * y[:, -1])
        )
        < 1e-3
    )


@pytest.mark.parametrize("limits", LIMITS)
def test_yaw_gives_the_same_thrusts(limits):
    grid = Grid(6, 48)
    samples = LapSamples.of(loop(), grid, limits, TURN)
    units = samples.units
    thrusts, force, w, alpha = angle_dynamics(samples.flat, units, samples.axes, limits)
    lap = FlatTrajectory(flat_polynomial(samples.lap, limits, TURN, 8))
    times = samples.lap.sample_times(grid.fractions).ravel()
    flat = lap.sample(times)
    places = samples.derivatives[0, ..., :3].reshape(-1, 3)
    np.testing.assert_allclose(as_reference(flat).position.T, places, atol=1e-9)
    expected, rates = inverse_dynamics(flat, limits.vehicle)
    np.testing.assert_allclose(thrusts / units**2, expected, atol=1e-3)
    np.testing.assert_allclose(w / units, rates, atol=1e-4)
    # Between the breaks yaw is interpolated: its derivatives must be those of its values.
    h = 1e-4
    between = np.linspace(0.1, lap.duration - 0.1, 997)
    yaw = [as_reference(lap.sample(between + e)).yaw for e in (-h, 0.0, h)]
    flat = lap.sample(between)
    np.testing.assert_allclose((yaw[2] - yaw[0]) / (2 * h), as_reference(flat).yaw_rate, atol=1e-4)
    np.testing.assert_allclose(
        (yaw[2] - 2 * yaw[1] + yaw[0]) / h**2, as_reference(flat).yaw_acceleration, atol=0.05
    )


def test_yaw_of_attitude_inverts_attitude_from_force():
    rng = np.random.default_rng(0)
    force = rng.normal(size=(3, 50)) * 3.0 + [[0.0], [0.0], [12.0]]
    rates = rng.normal(size=(2, 3, 50)) * 5.0
    yaw = np.sort(rng.uniform(-3, 3, 50))
    yaw_rate, yaw_acceleration = rng.normal(size=(2, 50)) * 2.0
    axes, w, alpha = attitude_from_force(
        force, *rates, heading_vectors(np.cos(yaw), np.sin(yaw), yaw_rate, yaw_acceleration)
    )
    found = yaw_of_attitude([np.array(a) for a in axes], np.array(w), np.array(alpha))
    np.testing.assert_allclose(found[0], yaw, atol=1e-9)
    np.testing.assert_allclose(found[1], yaw_rate, atol=1e-9)
    np.testing.assert_allclose(found[2], yaw_acceleration, atol=1e-8)
