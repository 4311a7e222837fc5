"""Regions of gates: membership, the nearest points, and refusals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.solvers import ClarabelSolver, MathematicalProgram

from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.gate_regions import GateRegions, Region

MIDPOINTS, HEADINGS = np.array([[0.0, 0, 6], [20, 10, 6], [0, 30, 7]]), [0.3, 1.5, 4.0]
# A pentagon, tilted and turned.
ANGLES = np.arange(5) * 2 * np.pi / 5
TILTED = np.column_stack([np.cos(ANGLES), np.sin(ANGLES), 0 * ANGLES]) @ np.array(
    [[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]]
)
REGIONS = {
    "windows": GateRegions.windows(MIDPOINTS, HEADINGS, [1.0, 2.0, 3.0], 2.5),
    "balls": GateRegions.balls(MIDPOINTS, HEADINGS, 1.5),
    "points": GateRegions.balls(MIDPOINTS, HEADINGS, 0.0),
    "polygons": GateRegions.of_regions(
        [Region.polygon(p + TILTED) for p in MIDPOINTS], between=(MIDPOINTS[0] + 9.0, [50, 0, 0])
    ),
}


@settings(max_examples=20)
@given(st.sampled_from(sorted(REGIONS)), st.lists(st.floats(-9, 9), min_size=3, max_size=3))
def test_the_constraint_and_the_nearest_point_agree(kind, offset):
    gates = REGIONS[kind]
    points = gates.midpoints + np.array(offset)
    nearest = gates.nearest(points)
    np.testing.assert_allclose(gates.nearest(nearest), nearest, atol=1e-5)
    for i, point in enumerate(points):
        program = MathematicalProgram()
        step = program.NewContinuousVariables(3)
        gates.constrain(program, i, step, point)
        program.AddQuadraticCost(np.eye(3), np.zeros(3), step, is_convex=True)
        found = ClarabelSolver().Solve(program).GetSolution(step)
        np.testing.assert_allclose(point + found, nearest[i], atol=1e-3)


def test_windows_are_across_the_heading():
    gates = REGIONS["windows"]
    ahead = gates.nearest(MIDPOINTS + 5.0 * gates.forward)
    np.testing.assert_allclose(ahead, MIDPOINTS, atol=1e-9)
    beside = gates.nearest(MIDPOINTS + 50.0 * gates.rightward + [0, 0, 50.0])
    np.testing.assert_allclose(
        beside, MIDPOINTS + np.array([[1.0], [2.0], [3.0]]) * gates.rightward + [0, 0, 2.5]
    )


@pytest.mark.parametrize(
    "midpoints, headings, width",
    [
        (MIDPOINTS[:1], [0.0], 1.0),
        (MIDPOINTS, [0.0, np.nan, 0.0], 1.0),
        (MIDPOINTS[[0, 1, 1]], HEADINGS, 1.0),
        (MIDPOINTS[[0, 1, 0]], HEADINGS, 1.0),
        (MIDPOINTS, HEADINGS, [1.0, -0.1, 1.0]),
        (np.full_like(MIDPOINTS, np.inf), HEADINGS, 1.0),
        (MIDPOINTS, HEADINGS[:2], 2.0),
    ],
)
def test_impossible_gates_are_refused(midpoints, headings, width):
    with pytest.raises(TrajectoryOptimizationError):
        GateRegions.windows(midpoints, headings, width, 2.5)


@pytest.mark.parametrize(
    "corners",
    [
        TILTED[:2],
        TILTED[[0, 2, 4, 1, 3]],
        TILTED + [[0, 0, 0.1], *4 * [[0, 0, 0]]],
        TILTED[[0, 1, 1, 2]],
        np.outer(np.arange(4), [1, 2, 3]),
    ],
    ids=["two", "a star", "not flat", "one twice", "in a line"],
)
def test_what_is_no_flat_convex_polygon_is_refused(corners):
    with pytest.raises(TrajectoryOptimizationError, match="polygon"):
        Region.polygon(corners)


@pytest.mark.parametrize("size", [np.nan, -1.0])
def test_a_region_has_a_size(size):
    for make in (
        lambda: Region.window(MIDPOINTS[0], 0.0, size, 1.0),
        lambda: Region.window(MIDPOINTS[0], 0.0, 1.0, size),
        lambda: Region.polygon(TILTED, size),
        lambda: Region.ball(MIDPOINTS[0], size),
    ):
        with pytest.raises(TrajectoryOptimizationError, match="negative, or no number"):
            make()
    with pytest.raises(TrajectoryOptimizationError, match="no number"):
        Region.window(MIDPOINTS[0], np.nan, 1.0, 1.0)


def test_a_prism_reaches_as_far_to_both_sides_of_its_polygon():
    prism, normal = (
        Region.polygon(TILTED, 4.0),
        np.cross(TILTED[1] - TILTED[0], TILTED[2] - TILTED[1]),
    )
    normal /= np.linalg.norm(normal)
    for side in (-1.0, 1.0):
        inside, outside = (prism.midpoint + side * reach * normal for reach in (1.9, 5.0))
        np.testing.assert_allclose(prism.nearest(inside), inside, atol=1e-6)
        end = prism.midpoint + 2.0 * side * normal
        np.testing.assert_allclose(prism.nearest(outside), end, atol=1e-4)


def test_start_and_goal_are_points_around_the_gates():
    gates = REGIONS["polygons"]
    assert not gates.is_closed and gates.ends == (0, 4) and gates.after.tolist() == [1, 2, 3, 4]
    np.testing.assert_array_equal(gates.nearest(gates.midpoints + 1.0)[-1], [50, 0, 0])


def test_a_negative_radius_is_refused():
    with pytest.raises(TrajectoryOptimizationError):
        GateRegions.balls(MIDPOINTS, HEADINGS, -0.1)
