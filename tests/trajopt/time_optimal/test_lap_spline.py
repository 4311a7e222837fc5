"""Laps of quintic splines: smooth all around, and what dilation and the thrust-axis angle do."""

import numpy as np
import pytest

from airrace.trajopt.time_optimal.lap_spline import LapSpline, basis


@pytest.fixture(params=[5, 6, 9])
def lap(request):
    rng = np.random.default_rng(request.param)
    n, m = 4, request.param - 5
    gates = rng.normal(size=(n, 5, 4)) * 3.0 ** np.arange(5)[:, None]
    return LapSpline(gates, rng.normal(size=(n, m, 4)), rng.uniform(0.5, 2.0, n), 2 * np.pi)


def test_it_has_the_derivatives_of_its_gates_at_both_sides(lap):
    y = lap.evaluate(basis(lap.pieces, (0.0, 1.0)))
    y = y / (lap.durations[:, None] ** np.arange(5)).T[:, :, None, None]
    start, end = np.moveaxis(y[:, :, 0], 0, 1), np.moveaxis(y[:, :, 1], 0, 1)
    np.testing.assert_allclose(start, lap.gates, rtol=1e-8, atol=1e-8)
    after = np.roll(lap.gates, -1, axis=0)
    after[-1, 0, 3] += lap.turn
    np.testing.assert_allclose(end, after, rtol=1e-7, atol=1e-7)


def test_it_is_smooth_through_snap_at_its_knots(lap):
    knots = np.arange(1, lap.pieces) / lap.pieces
    before, after = (lap.evaluate(basis(lap.pieces, tuple(knots + e))) for e in (-1e-9, 1e-9))
    np.testing.assert_allclose(before, after, atol=1e-6 * np.abs(before).max())


def test_derivatives_are_those_of_values(lap):
    h = 1e-5
    s = np.array([0.11, 0.37, 0.93])
    below, at, above = (lap.evaluate(basis(lap.pieces, tuple(s + e))) for e in (-h, 0.0, h))
    difference = (above[:-1] - below[:-1]) / (2 * h)
    np.testing.assert_allclose(difference, at[1:], rtol=1e-4, atol=1e-3 * np.abs(at).max())


def test_dilation_keeps_the_path(lap):
    matrices = basis(lap.pieces, (0.0, 0.2, 0.77))
    slow = lap.dilated(1.7)
    np.testing.assert_allclose(slow.evaluate(matrices), lap.evaluate(matrices), atol=1e-9)
    assert slow.duration == pytest.approx(1.7 * lap.duration)


def test_another_turn_is_spread_evenly(lap):
    fractions = (0.0, 0.4, 0.9)
    turned = lap.with_turn(lap.turn + 0.8)
    difference = turned.evaluate(basis(lap.pieces, fractions)) - lap.evaluate(
        basis(lap.pieces, fractions)
    )
    expected = 0.8 * lap.sample_times(fractions) / lap.duration
    np.testing.assert_allclose(difference[0, ..., 3], expected, atol=1e-9)
    np.testing.assert_allclose(difference[2:], 0.0, atol=1e-6)
    np.testing.assert_allclose(difference[..., :3], 0.0, atol=1e-12)


def test_a_path_through_velocities_of_its_own(lap):
    fractions = tuple(np.linspace(0.0, 1.0, 40))
    T = lap.durations
    v = lap.evaluate(basis(lap.pieces, fractions))[1, ..., :3] / T[:, None, None]
    again = LapSpline.through(lap.gates[:, 0, :3], v, T, lap.pieces, 0.0)
    matrices = basis(lap.pieces, fractions)[:2]
    difference = again.evaluate(matrices) - lap.evaluate(matrices)
    np.testing.assert_allclose(difference[..., :3], 0.0, atol=1e-3 * np.abs(v).max())


def open_spline():
    rng = np.random.default_rng(3)
    gates = rng.normal(size=(4, 5, 4))
    return LapSpline(
        gates,
        rng.normal(size=(3, 1, 4)),
        np.array([0.8, 1.1, 1.4]),
        float(gates[-1, 0, 3] - gates[0, 0, 3]),
    )


def test_an_open_one_leads_from_gate_to_gate():
    spline = open_spline()
    assert not spline.is_closed and spline.after.tolist() == [1, 2, 3]
    ends = spline.evaluate(basis(spline.pieces, (0.0, 1.0)))  # (5, 3, 2, 4)
    powers = spline.durations ** np.arange(5)[:, None]
    for leg in range(3):
        for end in (0, 1):
            np.testing.assert_allclose(
                ends[:, leg, end] / powers[:, leg, None], spline.gates[leg + end], atol=1e-9
            )


def test_another_turn_of_an_open_one_is_at_its_end():
    spline = open_spline()
    other = spline.with_turn(2.0)
    assert other.gates[-1, 0, 3] == pytest.approx(spline.gates[0, 0, 3] + 2.0)
    np.testing.assert_array_equal(other.gates[:-1], spline.gates[:-1])
    np.testing.assert_array_equal(other.gates[-1, 1:], spline.gates[-1, 1:])


def test_a_step_of_an_open_one_keeps_what_its_ends_have():
    spline = open_spline()
    z = spline.coefficients() + np.random.default_rng(0).normal(size=spline.coefficients().shape)
    new = spline.stepped(z, 1.1 * spline.durations, 0.3)
    for i in (0, -1):
        np.testing.assert_array_equal(new.gates[i, :, :3], spline.gates[i, :, :3])
        np.testing.assert_array_equal(new.gates[i, 1:3, 3], spline.gates[i, 1:3, 3])
    assert new.gates[0, 0, 3] == spline.gates[0, 0, 3] and new.turn == 0.3
    # With nothing changed, nothing changes.
    same = spline.stepped(spline.coefficients(), spline.durations, spline.turn)
    np.testing.assert_allclose(same.gates, spline.gates, atol=1e-9)
