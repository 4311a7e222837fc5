"""The allocation: exact where it can be, optimal where it cannot, and never out of limits."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.solvers import ClpSolver, MathematicalProgram

from airrace.vehicle import GRAVITY, allocation, load_vehicle
from airrace.vehicle.allocation import Allocator, wrench_margin

VEHICLES = {name: load_vehicle(name)[0] for name in ("Default", "StarOne")}
few = settings(max_examples=15)
drones = st.sampled_from(list(VEHICLES))


def wrenches(vehicle, size=3.0):
    """Around all that the rotors can do, and beyond."""
    most = np.abs(vehicle.allocation) @ vehicle.max_thrusts
    share = st.floats(-size, size)
    # Those of hypothesis are often at corners; evenly spread ones are not.
    spread = st.integers(0, 2**32 - 1).map(
        lambda seed: np.random.default_rng(seed).uniform(-size, size, 4)
    )
    return (st.tuples(*[share] * 4) | spread).map(lambda shares: most * shares)


@st.composite
def cases(draw, size=3.0, most_lost=8):
    """Allocation matrix, limits with any rotors lost, and a wrench."""
    vehicle = VEHICLES[draw(drones)]
    limits = vehicle.max_thrusts
    lost = draw(st.sets(st.integers(0, len(limits) - 1), max_size=most_lost))
    limits[list(lost)] = 0.0
    return vehicle.allocation, limits, draw(wrenches(vehicle, size))


class Thrusts:
    """A linear program over thrusts (n,) within their limits: a method of its own."""

    def __init__(self, B, limits):
        self.B = B
        self.program = MathematicalProgram()
        self.thrusts = self.program.NewContinuousVariables(len(limits))
        self.program.AddBoundingBoxConstraint(np.zeros(len(limits)), limits, self.thrusts)

    def fix(self, rows, wrench):
        self.program.AddLinearEqualityConstraint(self.B[rows], wrench[rows], self.thrusts)
        return self

    def feasible(self):
        return ClpSolver().Solve(self.program).is_success()

    def least_deviation(self, row, value):
        """Returns the least |B[row] thrusts - value|."""
        slack = self.program.NewContinuousVariables(1)
        for sign in (1.0, -1.0):
            self.program.AddLinearConstraint(
                np.append(sign * self.B[row], -1.0)[None],
                [-np.inf],
                [sign * value],
                [*self.thrusts, *slack],
            )
        self.program.AddLinearCost(slack[0])
        result = ClpSolver().Solve(self.program)
        return result.get_optimal_cost() if result.is_success() else None

    def farthest(self, wrench, direction):
        """Returns the greatest t with wrench + t direction attainable, and a facet there.

        The facet's normal are the multipliers of the constraint.
        """
        t = self.program.NewContinuousVariables(1)
        reached = self.program.AddLinearEqualityConstraint(
            np.column_stack([self.B, -direction]), wrench, [*self.thrusts, *t]
        )
        self.program.AddLinearCost(-t[0])
        result = ClpSolver().Solve(self.program)
        if not result.is_success():
            return -np.inf, None
        return -result.get_optimal_cost(), result.GetDualSolution(reached)


@pytest.mark.slow
@pytest.mark.parametrize("drone", VEHICLES)
@given(data=st.data())
def test_the_pseudo_inverse_within_the_limits(drone, data):
    vehicle = VEHICLES[drone]
    B, limits = vehicle.allocation, vehicle.max_thrusts
    thrusts = data.draw(st.lists(st.floats(0, 8.5), min_size=len(limits), max_size=len(limits)))
    inverse = np.linalg.pinv(B)
    # Of least effort, and drawn to the middle until it fits, with some room for rounding.
    offset = inverse @ B @ thrusts - limits / 2
    thrusts = limits / 2 + offset * min(1.0, 4.2499 / max(np.abs(offset).max(), 1e-9))
    result = Allocator(B, limits).allocate(B @ thrusts)
    np.testing.assert_allclose(result, thrusts, atol=1e-9)
    np.testing.assert_allclose(B @ result, B @ thrusts, atol=1e-9)


@given(cases(size=1e6), st.booleans())
def test_never_outside_the_limits(case, yaw):
    B, limits, wrench = case
    thrusts = Allocator(B, limits, yaw).allocate(wrench)
    assert thrusts.shape == limits.shape
    assert np.all(thrusts >= 0.0) and np.all(thrusts <= limits)


@given(cases(), st.floats(-1e-300, 1e-300), st.booleans())
def test_almost_nothing_is_wanted(case, tiny, yaw):
    B, limits, wrench = case
    thrusts = Allocator(B, limits, yaw).allocate(tiny * wrench)
    np.testing.assert_allclose(thrusts, 0.0, atol=1e-9)


def weighted_problem(B, limits, wrench):
    """Returns A and b of the cost |A x - b|^2 in the shares x of the limits."""
    scale = allocation._WEIGHTS[: len(B)] / np.maximum(np.abs(B) @ limits, 1e-9)
    effort = allocation._EFFORT * np.eye(len(limits))
    A = np.vstack([scale[:, None] * B * limits, effort])
    return A, np.concatenate([scale * wrench, np.zeros(len(limits))])


@settings(max_examples=300)
@given(cases(size=1.0, most_lost=4), st.booleans())
def test_the_optimum_is_one_by_its_conditions(case, yaw):
    """Karush, Kuhn and Tucker: no rotor can lower the cost by moving where it may move."""
    B, limits, wrench = case
    thrusts = Allocator(B, limits, yaw).allocate(wrench)
    working = limits > 0
    B, wrench = B[: 4 if yaw else 3, working], wrench[: 4 if yaw else 3]
    A, b = weighted_problem(B, limits[working], wrench)
    if np.allclose(B @ thrusts[working], wrench, atol=1e-9):
        return  # within the limits; what effort could be saved is not wanted
    x = thrusts[working] / limits[working]
    slope = A.T @ (b - A @ x)
    # For comparison: all of the thrust missing is a slope of 2500, all of the yaw 0.1.
    assert np.all(slope[x < 1.0] < 5e-4) and np.all(slope[x > 0.0] > -5e-4)


@given(wrenches(VEHICLES["Default"]))
def test_no_choice_of_rotors_at_their_limits_is_better(wrench):
    B, limits = VEHICLES["Default"].allocation, VEHICLES["Default"].max_thrusts
    thrusts = Allocator(B, limits).allocate(wrench)
    if np.allclose(B @ thrusts, wrench, atol=1e-9):
        return
    A, b = weighted_problem(B, limits, wrench)
    best, least = None, np.inf
    for choice in itertools.product((0.0, 1.0, np.nan), repeat=4):
        x = np.array(choice)
        free = np.isnan(x)
        x[free] = 0.0
        if free.any():
            x[free] = np.linalg.lstsq(A[:, free], b - A @ x, rcond=None)[0]
        cost = np.linalg.norm(A @ x - b)
        if cost < least and x.min() > -1e-9 and x.max() < 1 + 1e-9:
            best, least = x, cost
    np.testing.assert_allclose(thrusts, limits * best, atol=1e-4)


@settings(max_examples=150)
@given(cases(size=1.0, most_lost=3))
def test_roll_and_pitch_then_thrust_then_yaw(case):
    """What some thrusts can produce is produced, in that order: by linear programs."""
    B, limits, wrench = case
    achieved = B @ Allocator(B, limits).allocate(wrench)
    if not Thrusts(B, limits).fix([1, 2], wrench).feasible():
        return
    most = np.abs(B) @ limits
    np.testing.assert_allclose(achieved[1:3], wrench[1:3], atol=5e-6 * most[1])
    # Yaw may cost a ten-thousandth of the thrust, as the square of its weight.
    least = Thrusts(B, limits).fix([1, 2], achieved).least_deviation(0, wrench[0])
    assert abs(achieved[0] - wrench[0]) <= least + 1e-3 * most[0]
    least = Thrusts(B, limits).fix([0, 1, 2], achieved).least_deviation(3, wrench[3])
    if least is not None:  # which can differ by rounding
        assert abs(achieved[3] - wrench[3]) <= least + 1e-3 * most[3]


def test_yaw_gives_way_before_thrust():
    vehicle = VEHICLES["Default"]
    allocator = Allocator(vehicle.allocation, vehicle.max_thrusts)
    # All of the thrust leaves no room for yaw.
    achieved = vehicle.allocation @ allocator.allocate(np.array([34.0, 0.0, 0.0, 0.1]))
    np.testing.assert_allclose(achieved, [34.0, 0, 0, 0], atol=2e-3)
    # Some room: some of it.
    achieved = vehicle.allocation @ allocator.allocate(np.array([30.0, 0.0, 0.0, 0.1]))
    np.testing.assert_allclose(achieved, [30.0, 0, 0, 0.04], atol=2e-3)


def test_without_yaw_it_is_the_pseudo_inverse_of_the_rest():
    vehicle = VEHICLES["Default"]
    limits = vehicle.max_thrusts
    limits[0] = 0.0  # three rotors for three axes
    wrench = np.array([6.0, 0.1, -0.2, 1e3])
    thrusts = Allocator(vehicle.allocation, limits, yaw=False).allocate(wrench)
    np.testing.assert_allclose((vehicle.allocation @ thrusts)[:3], wrench[:3], atol=1e-9)


def scaled(B, limits):
    """Returns the allocation whose components are shares of their greatest amounts."""
    return B / (np.abs(B) @ limits)[:, None]


@few
@given(cases(size=1.0, most_lost=2), st.integers(0, 2**32 - 1), st.booleans())
def test_the_margin_by_linear_programs(case, seed, at_hover):
    """No direction leads out sooner than the margin says, and one leads out just then."""
    B, limits, wrench = case
    if at_hover:
        wrench = np.array([GRAVITY * (1.0 if len(limits) == 4 else 3.0), 0.0, 0.0, 0.0])
    margin = wrench_margin(B, limits, wrench)
    shares = scaled(B, limits)
    start = wrench / (np.abs(B) @ limits)
    feasible = Thrusts(B, limits).fix(range(4), wrench).feasible()
    if abs(margin) > 1e-9:
        assert feasible == (margin > 0)
    if not feasible or margin <= 1e-9:
        return
    shortest = np.inf
    for direction in itertools.product((-1.0, 0.0, 1.0), repeat=4):
        direction = direction + np.random.default_rng(seed).normal(size=4, scale=0.1)
        # Then along the normal of the facet that was hit.
        for _ in range(2):
            direction /= np.linalg.norm(direction)
            reach, normal = Thrusts(shares, limits).farthest(start, direction)
            assert reach >= margin - 1e-7
            shortest = min(shortest, reach)
            direction = normal * np.sign(normal @ direction)
    assert shortest == pytest.approx(margin, abs=1e-6)


def test_the_margin_where_it_is_plain():
    """Two rotors on a beam: the set of [f, M] is a square on its corner."""
    B, limits = np.array([[1.0, 1.0], [1.0, -1.0]]), np.array([1.0, 1.0])
    assert wrench_margin(B, limits, [1.0, 0.0]) == pytest.approx(np.sqrt(2) / 4)
    assert wrench_margin(B, limits, [0.0, 0.0]) == pytest.approx(0.0)
    assert wrench_margin(B, limits, [0.0, 1.0]) < -0.1
    # Without a rotor there is no moment to choose.
    assert wrench_margin(B, np.array([1.0, 0.0]), [0.5, 0.5]) == -np.inf
    assert wrench_margin(np.array([[1.0, 1.0], [0.0, 0.0]]), limits, [1.0, 0.0]) == -np.inf
    assert wrench_margin(B, np.zeros(2), [1.0, 0.0]) == -np.inf


@few
@given(cases(size=1.0, most_lost=2), st.integers(0, 2**32 - 1), st.floats(0.1, 10.0))
def test_the_margin_keeps_when_units_or_the_rotors_order_change(case, seed, unit):
    B, limits, wrench = case
    margin = wrench_margin(B, limits, wrench)
    order = np.random.default_rng(seed).permutation(len(limits))
    assert wrench_margin(B[:, order], limits[order], wrench) == pytest.approx(margin, abs=1e-9)
    units = np.array([1.0, unit, 1.0, 1.0 / unit])
    assert wrench_margin(units[:, None] * B, limits, units * wrench) == pytest.approx(
        margin, abs=1e-9
    )


def test_which_pairs_the_star_one_can_lose():
    """16 of 28: not both of one arm, and not neighbours that turn the same way."""
    vehicle = VEHICLES["StarOne"]
    hover = [vehicle.mass * GRAVITY, 0.0, 0.0, 0.0]
    fatal = set()
    for pair in itertools.combinations(range(8), 2):
        limits = vehicle.max_thrusts
        limits[list(pair)] = 0.0
        if wrench_margin(vehicle.allocation, limits, hover) <= 1e-9:
            fatal.add(pair)
    same_arm = {(i, i + 4) for i in range(4)}
    alike = {
        (i, j)
        for i, j in itertools.combinations(range(8), 2)
        if vehicle.rotors[i].direction == vehicle.rotors[j].direction and (i - j) % 4 in (1, 3)
    }
    assert len(same_arm) == 4 and len(alike) == 8
    assert fatal == same_arm | alike
