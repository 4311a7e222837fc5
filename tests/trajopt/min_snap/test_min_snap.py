"""Minimum snap as axioms: feasible, optimal, smooth, and equivariant."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RollPitchYaw
from pydrake.trajectories import PiecewisePolynomial

from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.gate_regions import turn_per_lap
from airrace.trajopt.min_snap.min_snap import DerivativeConstraint, solve_min_snap

NAN = np.nan
few = settings(max_examples=25)
seeds = st.integers(0, 10**6)


def make_problem(seed, *, periodic=None, dimension=4):
    """Returns (waypoints, durations, options) of a random problem."""
    rng = np.random.default_rng(seed)
    periodic = bool(rng.integers(2)) if periodic is None else periodic
    m = int(rng.integers(4, 9))
    shape = (m, dimension)
    waypoints = np.cumsum(rng.uniform(5, 30, shape) * rng.choice([-1, 1], shape), axis=0)
    durations = rng.uniform(0.8, 4.0, m if periodic else m - 1)
    options = dict(periodic=periodic)
    if periodic:
        options["period_offset"] = np.append(np.zeros(dimension - 1), 2 * np.pi)
    return waypoints, durations, options


def random_constraints(rng, count, dimension, orders=(1, 2, 3, 4)):
    """Returns constraints at every waypoint; about half of the values are NaN."""
    value = np.where(rng.random((count, dimension)) < 0.5, NAN, rng.normal(size=(count, dimension)))
    return [DerivativeConstraint(i, int(rng.choice(orders)), 10 * v) for i, v in enumerate(value)]


def derivative(trajectory, time, order):
    return trajectory.EvalDerivative(time, order).ravel()


def jump(trajectory, i, order):
    """Returns the jump of a derivative at break i, which lies inside."""
    before = trajectory.getPolynomialMatrix(i - 1)[:, 0]
    after = trajectory.getPolynomialMatrix(i)[:, 0]

    def value(p, t):
        return p.Derivative(order).EvaluateUnivariate(t) if order else p.EvaluateUnivariate(t)

    duration = trajectory.duration(i - 1)
    return np.array([value(b, 0.0) - value(a, duration) for a, b in zip(before, after)])


def cost(trajectory, order):
    """Returns the integral of the squared derivative, per dimension."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    p, total = trajectory.derivative(order), 0.0
    for i in range(trajectory.get_number_of_segments()):
        start, end = trajectory.start_time(i), trajectory.end_time(i)
        values = p.vector_values((start + end) / 2 + (end - start) / 2 * nodes)
        total = total + (end - start) / 2 * (values**2 @ weights)
    return total


def independent_solution(
    waypoints,
    durations,
    *,
    constraints=(),
    periodic=False,
    period_offset=None,
    degree=9,
    minimized_derivative=4,
):
    """Returns samples (segments, 9, d) of the minimiser, by other means.

    Legendre coefficients of every segment, explicit constraints for waypoints
    and continuity, and least squares in their null space.
    """
    m, d = waypoints.shape
    s, n, r = len(durations), (degree + 1) // 2, minimized_derivative
    legendre = np.polynomial.legendre

    def row(x, order, segment):
        basis = legendre.legder(np.eye(degree + 1), order) if order else np.eye(degree + 1)
        return legendre.legval(x, basis) * (2 / durations[segment]) ** order

    def place(*rows):
        full = np.zeros((s, degree + 1))
        for segment, values in rows:
            full[segment] += values
        return full.ravel()

    nodes, weights = legendre.leggauss(degree + 1)
    root = np.vstack(
        [  # its squared norm is the cost
            place((i, np.sqrt(w * T / 2) * row(x, r, i)))
            for i, T in enumerate(durations)
            for x, w in zip(nodes, weights)
        ]
    )
    result = []
    for j in range(d):
        rows, right = [], []
        for i in range(s):
            last = (0.0 if period_offset is None else period_offset[j]) if i + 1 == m else 0.0
            rows += [place((i, row(-1, 0, i))), place((i, row(1, 0, i)))]
            right += [waypoints[i, j], waypoints[(i + 1) % m, j] + last]
        for i in range(s if periodic else s - 1):
            k = (i + 1) % s
            rows += [place((i, row(1, o, i)), (k, -row(-1, o, k))) for o in range(1, n)]
            right += [0.0] * (n - 1)
        for c in constraints:
            if not np.isnan(c.value[j]):
                i = c.waypoint % m
                start = i < s  # else it is the end of the last segment
                segment = i if start else i - 1
                rows.append(place((segment, row(-1 if start else 1, c.order, segment))))
                right.append(c.value[j])
        rows, right = np.array(rows), np.array(right)
        size = np.linalg.norm(rows, axis=1)
        U, S, Vt = np.linalg.svd(rows / size[:, None])
        feasible = Vt[: len(S)].T @ (U.T @ (right / size) / S)
        null = Vt[len(S) :].T
        coefficients = feasible - null @ np.linalg.lstsq(root @ null, root @ feasible)[0]
        coefficients = coefficients.reshape(s, degree + 1)
        result.append(legendre.legval(np.linspace(-1, 1, 9), coefficients.T))
    return np.moveaxis(np.array(result), 0, 2)


@few
@given(seeds)
def test_waypoints_breaks_and_closure(seed):
    waypoints, durations, options = make_problem(seed)
    p = solve_min_snap(waypoints, durations, **options)
    assert p.rows() == waypoints.shape[1] and p.start_time() == 0.0
    np.testing.assert_allclose(np.diff(p.get_segment_times()), durations, rtol=1e-12)
    closed = waypoints
    if options["periodic"]:
        closed = np.vstack([waypoints, waypoints[0] + options["period_offset"]])
    np.testing.assert_allclose(p.vector_values(p.get_segment_times()).T, closed, atol=1e-9)


@few
@given(seeds, st.booleans())
def test_continuity_through_snap_around_the_loop(seed, constrained):
    waypoints, durations, options = make_problem(seed)
    rng = np.random.default_rng(seed)
    constraints = random_constraints(rng, len(waypoints), 4) if constrained else []
    p = solve_min_snap(waypoints, durations, constraints=constraints, **options)
    for order in range(1, 5):
        values = p.derivative(order).vector_values(p.get_segment_times())
        tolerance = 1e-8 if order < 4 else 1e-8 * max(1.0, np.abs(values).max())
        for i in range(1, len(durations)):
            np.testing.assert_allclose(jump(p, i, order), 0.0, atol=tolerance)
        if options["periodic"]:
            seam = derivative(p, p.end_time(), order) - derivative(p, 0.0, order)
            np.testing.assert_allclose(seam, 0.0, atol=tolerance)


@pytest.mark.parametrize("degree, order", [(9, 4), (7, 4), (7, 3), (5, 2), (11, 5), (9, 2)])
@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("constrained", [False, True])
def test_agrees_with_an_independent_solution(degree, order, periodic, constrained):
    waypoints, durations, options = make_problem(7 * degree + order, periodic=periodic)
    options |= dict(degree=degree, minimized_derivative=order)
    if constrained:
        rng = np.random.default_rng(degree)
        options["constraints"] = random_constraints(rng, len(waypoints), 4, range(1, degree // 2))
    p = solve_min_snap(waypoints, durations, **options)
    expected = independent_solution(waypoints, durations, **options)
    times = np.array(p.get_segment_times())[:-1, None] + durations[:, None] * np.linspace(0, 1, 9)
    actual = p.vector_values(times.ravel()).T.reshape(expected.shape)
    np.testing.assert_allclose(actual, expected, atol=1e-6 * np.abs(expected).max())


@few
@given(seeds, st.integers(2, 4))
def test_every_other_feasible_trajectory_costs_more(seed, order):
    waypoints, durations, options = make_problem(seed)
    best = solve_min_snap(waypoints, durations, minimized_derivative=order, **options)
    rng = np.random.default_rng(seed)
    for size, rounding in ((10.0, 0.0), (1e-2, 1e-9)):
        i, k = int(rng.integers(len(waypoints))), int(rng.integers(1, 5))
        time = best.get_segment_times()[i]
        value = derivative(best, time, k) + size * rng.normal(size=4)
        other = solve_min_snap(
            waypoints,
            durations,
            minimized_derivative=order,
            constraints=[DerivativeConstraint(i, k, value)],
            **options,
        )
        assert np.all(cost(other, order) > cost(best, order) * (1 - rounding))


def test_periodic_minimum_acceleration_is_the_cubic_spline():
    waypoints, durations, _ = make_problem(3, periodic=True)
    p = solve_min_snap(waypoints, durations, periodic=True, degree=3, minimized_derivative=2)
    breaks = np.concatenate([[0.0], np.cumsum(durations)])
    spline = PiecewisePolynomial.CubicWithContinuousSecondDerivatives(
        breaks, list(np.vstack([waypoints, waypoints[:1]])[:, :, None]), periodic_end=True
    )
    times = np.linspace(0.0, breaks[-1], 100)
    np.testing.assert_allclose(p.vector_values(times), spline.vector_values(times), atol=1e-9)


def test_minimum_velocity_is_a_polygon():
    p = solve_min_snap([[0.0], [2.0], [1.0]], [1.0, 2.0], degree=1, minimized_derivative=1)
    np.testing.assert_allclose(p.vector_values([0.5, 1.5, 2.0]), [[1.0, 1.75, 1.5]])


@few
@given(seeds)
def test_minimum_snap_splines_have_degree_seven(seed):
    waypoints, durations, options = make_problem(seed)
    times = np.linspace(0.0, durations.sum(), 50)
    nine, seven = (
        solve_min_snap(waypoints, durations, degree=degree, **options).vector_values(times)
        for degree in (9, 7)
    )
    np.testing.assert_allclose(nine, seven, atol=1e-8 * np.abs(seven).max())


@few
@given(seeds, st.floats(0.05, 20.0))
def test_time_scaling(seed, s):
    waypoints, durations, options = make_problem(seed)
    constraints = random_constraints(np.random.default_rng(seed), len(waypoints), 4)
    slow = [DerivativeConstraint(c.waypoint, c.order, c.value / s**c.order) for c in constraints]
    p = solve_min_snap(waypoints, durations, constraints=constraints, **options)
    q = solve_min_snap(waypoints, s * durations, constraints=slow, **options)
    times = np.linspace(0.0, durations.sum(), 50)
    for order in range(3):
        expected = p.derivative(order).vector_values(times)
        actual = q.derivative(order).vector_values(s * times) * s**order
        np.testing.assert_allclose(actual, expected, atol=1e-8 * np.abs(expected).max())


@few
@given(seeds, st.lists(st.floats(-3, 3), min_size=3, max_size=3))
def test_rotating_and_moving_the_waypoints_does_so_to_the_trajectory(seed, rpy):
    waypoints, durations, _ = make_problem(seed, dimension=3, periodic=True)
    R, p = RollPitchYaw(rpy).ToRotationMatrix().matrix(), np.array([1e3, -2e3, 10.0])
    velocity = np.array([3.0, -4.0, 1.0])
    times = np.linspace(0.0, durations.sum(), 50)
    plain = solve_min_snap(
        waypoints, durations, periodic=True, constraints=[DerivativeConstraint(1, 1, velocity)]
    )
    moved = solve_min_snap(
        waypoints @ R.T + p,
        durations,
        periodic=True,
        constraints=[DerivativeConstraint(1, 1, R @ velocity)],
    )
    np.testing.assert_allclose(
        moved.vector_values(times), R @ plain.vector_values(times) + p[:, None], atol=1e-8
    )


@few
@given(seeds, st.integers(1, 5))
def test_a_lap_may_start_at_any_waypoint(seed, shift):
    waypoints, durations, options = make_problem(seed, periodic=True)
    shift %= len(waypoints)
    later = np.vstack([waypoints[shift:], waypoints[:shift] + options["period_offset"]])
    p = solve_min_snap(waypoints, durations, **options)
    q = solve_min_snap(later, np.roll(durations, -shift), **options)
    start = durations[:shift].sum()
    times = np.linspace(0.0, p.end_time() - start, 30)
    np.testing.assert_allclose(q.vector_values(times), p.vector_values(times + start), atol=1e-8)


@few
@given(seeds)
def test_constraints_hold_and_nan_is_free(seed):
    waypoints, durations, options = make_problem(seed)
    constraints = random_constraints(np.random.default_rng(seed), len(waypoints), 4)
    p = solve_min_snap(waypoints, durations, constraints=constraints, **options)
    for c in constraints:
        value = derivative(p, p.get_segment_times()[c.waypoint], c.order)
        fixed = ~np.isnan(c.value)
        np.testing.assert_allclose(value[fixed], c.value[fixed], atol=1e-8)
    only_x = [
        DerivativeConstraint(c.waypoint, c.order, [c.value[0], NAN, NAN, NAN]) for c in constraints
    ]
    free = solve_min_snap(waypoints, durations, **options)
    q = solve_min_snap(waypoints, durations, constraints=only_x, **options)
    times = np.linspace(0.0, p.end_time(), 30)
    np.testing.assert_allclose(q.vector_values(times)[0], p.vector_values(times)[0], atol=1e-9)
    np.testing.assert_allclose(q.vector_values(times)[1:], free.vector_values(times)[1:], atol=1e-9)


def test_constraint_at_minus_one_is_at_the_end():
    waypoints, durations, _ = make_problem(1, periodic=False)
    constraint = DerivativeConstraint(-1, 1, [0, 1, 2, 3])
    p = solve_min_snap(waypoints, durations, constraints=[constraint])
    np.testing.assert_allclose(derivative(p, p.end_time(), 1), [0, 1, 2, 3], atol=1e-9)


def test_rest_to_rest_polynomial():
    rest = [DerivativeConstraint(i, k, [0.0]) for i in (0, -1) for k in (1, 2, 3)]
    p = solve_min_snap([[0.0], [1.0]], [1.0], constraints=rest)
    t = np.linspace(0, 1, 11)
    np.testing.assert_allclose(
        p.vector_values(t)[0], 35 * t**4 - 84 * t**5 + 70 * t**6 - 20 * t**7, atol=1e-12
    )


def test_headings():
    headings = np.deg2rad([350.0, 10.0, 90.0, 180.0, 270.0])
    assert turn_per_lap(headings) == pytest.approx(2 * np.pi)
    assert turn_per_lap(headings[::-1]) == pytest.approx(-2 * np.pi)
    assert turn_per_lap(np.deg2rad([0.0, 45.0, 0.0, -45.0])) == 0.0


POINTS = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
BAD = {
    "finite": dict(waypoints=[[0.0, np.inf], [1.0, 1.0]]),
    "shape": dict(waypoints=[0.0, 1.0]),
    "m >= 2": dict(waypoints=[[0.0, 1.0]]),
    "waypoints 1 and 2 coincide; remove": dict(waypoints=POINTS[[0, 1, 1, 2]]),
    "waypoints 3 and 0 coincide": dict(
        waypoints=POINTS[[0, 1, 2, 0]], durations=np.ones(4), periodic=True
    ),
    "Durations must be 3": dict(durations=np.ones(4)),
    "Durations must be 4": dict(periodic=True),
    "positive": dict(durations=[1.0, 0.0, 1.0]),
    "positive and finite": dict(durations=[1.0, NAN, 1.0]),
    "degree must be odd": dict(degree=8),
    "at most": dict(degree=99),
    "minimized_derivative": dict(degree=5),
    "period_offset needs": dict(period_offset=[0.0, 0.0]),
    "2 finite numbers": dict(period_offset=[0.0], periodic=True, durations=np.ones(4)),
    "waypoint 4 of": dict(constraints=[DerivativeConstraint(4, 1, [0, 0])]),
    "waypoint -1 of": dict(constraints=[DerivativeConstraint(-1, 1, [0, 0])], periodic=True),
    "raise the degree": dict(constraints=[DerivativeConstraint(0, 5, [0, 0])]),
    "2 numbers or NaNs": dict(constraints=[DerivativeConstraint(0, 1, [0, np.inf])]),
    "numbers or NaNs": dict(constraints=[DerivativeConstraint(0, 1, 0)]),
    "differently": dict(constraints=[DerivativeConstraint(0, 1, [v, NAN]) for v in (1, 2)]),
}


@pytest.mark.parametrize("message", BAD)
def test_bad_input_is_one_clear_error(message):
    arguments = dict(waypoints=POINTS, durations=np.ones(3)) | BAD[message]
    with pytest.raises(ValueError, match=f"(?i){message}"):
        solve_min_snap(**arguments)


@pytest.mark.parametrize("count", [2, 3])
def test_too_few_fixed_values_are_refused(count):
    with pytest.raises(TrajectoryOptimizationError, match="not unique"):
        solve_min_snap(POINTS[:count], np.ones(count - 1))
    # As many as a cubic has coefficients are enough.
    start = [DerivativeConstraint(0, k, [1.0, 0.0]) for k in range(1, 5 - count)]
    p = solve_min_snap(POINTS[:count], np.ones(count - 1), constraints=start)
    np.testing.assert_allclose(cost(p, 4), 0.0, atol=1e-9)
