"""Room by what the map knows."""

import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.systems.planning.map_margins import (
    CONTROLLER,
    UNKNOWN_SQUARE,
    has_changed,
    largest_move,
    pylon_margins,
    tracking_margins,
)
from airrace.track.gate_map import GateEstimate, MarkerEstimate

GATES = tuple(
    GateEstimate(number=n, p_WG=np.array([20.0 * n, 0.0, 6.0]), heading=0.3 * n, spacing=10.0)
    for n in (0, 1, 5)
)
LEAST = pylon_margins(GATES, ())[0]
sigmas = st.floats(0.0, 0.5)


def marker(id, sigma):
    return MarkerEstimate(
        id=id,
        count=9,
        outliers=0,
        p_WM=np.zeros(3),
        normal=np.eye(3)[0],
        variance=np.array([sigma**2, sigma**2 / 4, 9.0]),
    )


def test_without_markers_it_is_what_the_controller_needs():
    np.testing.assert_array_equal(pylon_margins(GATES, ()), np.full(6, LEAST))
    assert 0.1 < LEAST < 0.5


@given(sigmas, sigmas)
def test_it_grows_with_the_worse_face_of_the_pylon_alone(front, back):
    """Gate 5, right pylon: markers 22 and 23."""
    margins = pylon_margins(GATES, (marker(22, front), marker(23, back)))
    expected = np.full(6, LEAST)
    expected[5] += min(3.0 * max(front, back), 1.0)
    np.testing.assert_allclose(margins, expected, atol=1e-12)


@pytest.mark.parametrize("sigma", [5.0, np.inf, np.nan])
def test_there_is_always_a_way_through(sigma):
    margins = pylon_margins(GATES, (marker(0, sigma),), moved=3.0)
    np.testing.assert_allclose(margins, LEAST + 1.0)


def test_narrow_gates_leave_a_way_through():
    narrow = dc.replace(GATES[0], spacing=4.0)
    np.testing.assert_allclose(
        pylon_margins((narrow, GATES[1]), (), moved=1.0), LEAST + np.array([0.5, 0.5, 1.0, 1.0])
    )


def test_gates_that_move_may_move_again():
    assert pylon_margins(GATES, (), moved=0.05).max() == LEAST  # observations got better
    np.testing.assert_allclose(pylon_margins(GATES, (), moved=0.6), LEAST + 0.6)


def test_moves():
    assert largest_move(GATES, GATES) == largest_move((), GATES) == 0.0
    moved = dc.replace(GATES[1], p_WG=GATES[1].p_WG + [0.3, 0.0, 0.4])
    assert largest_move((GATES[0], moved), GATES) == pytest.approx(0.5)
    turned = dc.replace(GATES[1], heading=GATES[1].heading + 2 * np.pi - 0.1)
    assert largest_move((turned,), GATES) == pytest.approx(0.5)
    assert largest_move((dc.replace(GATES[0], spacing=9.0),), GATES) == pytest.approx(1.0)
    assert largest_move((dc.replace(GATES[0], number=9),), GATES) == 0.0


def test_changes():
    assert not has_changed(GATES, GATES)
    assert has_changed(GATES[:2], GATES) and has_changed(GATES, ())
    near, far = (dc.replace(GATES[0], p_WG=GATES[0].p_WG + [s, 0.0, 0.0]) for s in (0.01, 0.05))
    assert not has_changed((near, *GATES[1:]), GATES)
    assert has_changed((far, *GATES[1:]), GATES)
    assert has_changed((dc.replace(GATES[0], heading=np.nan), *GATES[1:]), GATES)


def test_the_better_a_drone_follows_the_nearer_it_comes():
    squares = np.array([0.0, 0.03, 0.1, 0.2, 5.0]) ** 2
    np.testing.assert_allclose(tracking_margins(squares, 0.15), [0.15, 0.2, 0.4, 0.7, 1.0])
    assert (tracking_margins(squares, CONTROLLER)[:2] == CONTROLLER).all()
    assert tracking_margins(np.array([UNKNOWN_SQUARE]), 0.0) == CONTROLLER


def test_each_gate_has_its_own():
    each = np.array([0.15, 0.5, 0.3])
    margins = pylon_margins(GATES, (marker(0, 0.1),), tracking=each)
    np.testing.assert_allclose(margins, [0.45, 0.15, 0.5, 0.5, 0.3, 0.3])
