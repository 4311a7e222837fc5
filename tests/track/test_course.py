"""What everybody may ask of a course, whatever kind it is."""

import numpy as np
import pytest

from airrace.track import load_track


@pytest.mark.parametrize("name", ["student-airrace", "hexagon", "grand-prix"])
def test_its_parts_fit_together(name):
    course = load_track(name)
    n = len(course.gates)
    assert course.has_markers == (len(course.boards()) > 0)
    assert len(course.boards()) == 2 * len(course.pylons())
    assert len(course.pylons()) == 2 * n or len(course.frames()) == n
    way = course.way()
    np.testing.assert_array_equal(
        way[-n:] if not course.closed else way[:n], [gate.p_WG for gate in course.gates]
    )
    np.testing.assert_array_equal(way[0], way[-1] if course.closed else course.start.position)
    low, high = course.arena(5.0)
    outline = course.outline()
    np.testing.assert_allclose(outline[:, :2].min(0), low + 5.0)
    np.testing.assert_allclose(outline[:, :2].max(0), high[:2] - 5.0)
    assert high[2] == 5.0 and course.hover_height > 0.0


@pytest.mark.parametrize("name", ["hexagon", "grand-prix"])
def test_every_gate_has_an_opening_between_its_sides_and_moves_with_it(name):
    course = load_track(name)
    shifts = np.random.default_rng(0).uniform(-1.0, 1.0, (len(course.gates), 2))
    for gate, there, move in zip(course.gates, course.shifted(shifts).gates, shifts):
        opening = gate.opening()
        axes = np.array([opening.forward, opening.rightward, opening.up])
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
        np.testing.assert_array_equal(opening.middle, gate.p_WG)
        assert opening.half_width <= gate.width / 2
        assert 0.0 < opening.high - opening.low <= gate.height
        assert np.linalg.norm(gate.p_WR - gate.p_WL) == pytest.approx(gate.width)
        np.testing.assert_allclose(there.opening().middle, gate.p_WG + [*move, 0.0], atol=1e-12)
        np.testing.assert_array_equal(there.forward, gate.forward)
    assert course.shifted(0.0 * shifts) == course
