import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.solvers import ClpSolver, MathematicalProgram

from airrace.vehicle import GRAVITY, load_vehicle
from airrace.vehicle.rotor_loss import Remaining

VEHICLES = {name: load_vehicle(name)[0] for name in ("Default", "StarOne")}
DEFAULT, STAR_ONE = VEHICLES.values()


def without(vehicle, *lost):
    return Remaining(vehicle, [i not in lost for i in range(len(vehicle.rotors))])


@st.composite
def losses(draw):
    drone = draw(st.sampled_from(list(VEHICLES)))
    return drone, draw(st.sets(st.integers(0, len(VEHICLES[drone].rotors) - 1)))


@pytest.mark.parametrize("vehicle", VEHICLES.values(), ids=VEHICLES)
def test_whole(vehicle):
    whole = without(vehicle)
    assert whole.can_hold_level and whole.can_fly
    np.testing.assert_array_equal(whole.max_thrusts, vehicle.max_thrusts)
    assert whole.max_lift == pytest.approx(vehicle.max_thrusts.sum(), rel=1e-6)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_a_quadrotor_can_spare_no_rotor(count):
    for lost in itertools.combinations(range(4), count):
        left = without(DEFAULT, *lost)
        assert not left.can_hold_level and not left.can_fly


def test_the_star_one_can_spare_any_rotor_and_some_pairs():
    assert all(without(STAR_ONE, i).can_fly for i in range(8))
    pairs = [without(STAR_ONE, *pair) for pair in itertools.combinations(range(8), 2)]
    assert sum(left.can_fly for left in pairs) == 16
    # Of a whole arm, the other three are left: a tricopter without a rotor to tilt.
    assert not any(without(STAR_ONE, i, i + 4).can_hold_level for i in range(4))


@given(losses())
def test_a_hover_is_held_by_what_is_left(case):
    drone, lost = case
    vehicle = VEHICLES[drone]
    left = without(vehicle, *lost)
    hover = np.array([vehicle.mass * GRAVITY, 0.0, 0.0, 0.0])
    thrusts = left.allocator.allocate(hover)
    assert np.all(thrusts[list(lost)] == 0.0)
    assert np.all(thrusts >= 0.0) and np.all(thrusts <= vehicle.max_thrusts)
    rows = 4 if left.can_fly else 3
    if left.can_hold_level:
        np.testing.assert_allclose((vehicle.allocation @ thrusts)[:rows], hover[:rows], atol=1e-3)
        assert left.max_lift > hover[0]


@given(losses())
def test_no_rotor_is_better_lost(case):
    drone, lost = case
    vehicle = VEHICLES[drone]
    left = without(vehicle, *lost)
    assert left.can_hold_level or not left.can_fly
    for i in lost:
        more = without(vehicle, *(lost - {i}))
        assert more.can_fly or not left.can_fly
        assert more.can_hold_level or not left.can_hold_level
        assert more.max_lift >= left.max_lift - 1e-3


@given(losses())
def test_the_lift_is_the_greatest_without_roll_or_pitch(case):
    """By a linear program."""
    drone, lost = case
    vehicle = VEHICLES[drone]
    left = without(vehicle, *lost)
    program = MathematicalProgram()
    thrusts = program.NewContinuousVariables(len(vehicle.rotors))
    program.AddBoundingBoxConstraint(np.zeros(len(thrusts)), left.max_thrusts, thrusts)
    program.AddLinearEqualityConstraint(vehicle.allocation[1:3], np.zeros(2), thrusts)
    program.AddLinearCost(-np.ones(len(thrusts)), 0.0, thrusts)
    expected = -ClpSolver().Solve(program).get_optimal_cost()
    assert left.max_lift == pytest.approx(expected, rel=1e-3, abs=1e-2)
