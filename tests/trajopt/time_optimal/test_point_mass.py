"""The lap of a point mass: known figures, known shapes, and refusals."""

import numpy as np
import pytest

from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.gate_regions import GateRegions
from tests.worlds.published_laps import (
    POINT_MASS_CASES,
    PointMassLimits,
    exact_bound,
    load_course,
    regions,
)

MIDPOINTS, HEADINGS, _ = load_course()


@pytest.mark.parametrize("case", POINT_MASS_CASES, ids=lambda case: case.name)
def test_the_reference_track(case):
    for kind in ("midpoints", "windows"):
        found = exact_bound(regions(kind, MIDPOINTS, HEADINGS), PointMassLimits(**case.limits))
        assert found.duration == pytest.approx(getattr(case, kind), rel=2e-3)


def circle(n=16, radius=30.0):
    angle = 2 * np.pi * np.arange(n) / n
    midpoints = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(n, 6.0)])
    return GateRegions.balls(midpoints, angle + np.pi / 2, 0.0)


def test_a_circle_takes_its_centripetal_acceleration():
    found = exact_bound(circle(), PointMassLimits(max_acceleration=10.0))
    assert found.duration == pytest.approx(2 * np.pi * np.sqrt(30.0 / 10.0), rel=0.01)


def test_a_circle_with_little_speed_takes_its_length():
    found = exact_bound(circle(), PointMassLimits(3.0, 50.0))
    assert found.duration == pytest.approx(2 * 16 * 30.0 * np.sin(np.pi / 16) / 3.0, rel=0.02)


def test_it_keeps_its_limits_and_its_gates():
    gates = regions("windows", MIDPOINTS, HEADINGS)
    found = exact_bound(gates, PointMassLimits(20.0, 10.0))
    assert np.linalg.norm(found.velocities, axis=2).max() <= 20.0 * (1 + 1e-6)
    step = found.durations[:, None, None] / (found.velocities.shape[1] - 1)
    acceleration = np.diff(found.velocities, axis=1) / step
    assert np.linalg.norm(acceleration, axis=2).max() <= 10.0 * (1 + 1e-4)
    np.testing.assert_allclose(found.positions, gates.nearest(found.positions), atol=1e-6)
    # It is one motion: velocities integrate to the positions, and go on at gates.
    middle = (found.velocities[:, 1:] + found.velocities[:, :-1]) / 2
    path = np.sum(middle * step, axis=1)
    np.testing.assert_allclose(
        found.positions + path, np.roll(found.positions, -1, axis=0), atol=1e-4
    )
    np.testing.assert_allclose(
        found.velocities[:, -1], np.roll(found.velocities[:, 0], -1, axis=0), atol=0.01
    )


def test_more_room_and_higher_limits_never_cost_time():
    durations = [
        exact_bound(regions(kind, MIDPOINTS, HEADINGS), PointMassLimits(20.0, a)).duration
        for kind, a in (("midpoints", 10.0), ("balls", 10.0), ("windows", 10.0), ("windows", 15.0))
    ]
    assert np.all(np.diff(durations) < 0.0)


@pytest.mark.parametrize(
    "limits",
    [
        {},
        {"max_speed": 20.0},
        {"max_acceleration": 0.0},
        {"max_acceleration": np.nan},
        {"max_speed": -1.0, "max_acceleration": 10.0},
        {"max_specific_force": 9.0},
    ],
)
def test_impossible_limits_are_refused(limits):
    with pytest.raises(TrajectoryOptimizationError):
        exact_bound(circle(), PointMassLimits(**limits))


def test_pylons_in_the_way_cost_time_and_are_kept_off():
    """Between two gates 40 m apart, one pylon stands on the straight line."""
    gates = GateRegions.balls([[0, 0, 5], [40, 0, 5]], [0.0, np.pi], 0.0)
    limits = PointMassLimits(20.0, 10.0)
    free = exact_bound(gates, limits)
    for clearance in (1.0, 3.0):
        bound = exact_bound(gates, limits, [[20.0, 0.3]], clearance)
        assert bound.duration > free.duration
        T, v = bound.durations, bound.velocities
        # Positions from velocities that are linear in between.
        N = v.shape[1] - 1
        for leg in range(2):
            path = np.cumsum((v[leg, 1:] + v[leg, :-1]) / 2 * T[leg] / N, axis=0)
            places = bound.positions[leg] + path
            assert np.linalg.norm(places[:, :2] - [20.0, 0.3], axis=1).min() > clearance - 0.05
    # Those elsewhere cost nothing.
    aside = exact_bound(gates, limits, [[20.0, 60.0]], 3.0)
    assert aside.duration == pytest.approx(free.duration, rel=1e-4)
