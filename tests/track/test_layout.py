import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.track import load_track, segment_distance
from airrace.track.layout import Layout, point_distances, segment_distances

_points = st.tuples(st.floats(-10, 10), st.floats(-10, 10))
_segments = st.lists(st.tuples(_points, _points), min_size=2, max_size=6)


@given(_segments)
def test_segment_distances_are_those_of_pairs(segments):
    starts, ends = np.array(segments).transpose(1, 0, 2)
    found = segment_distances(starts, ends)
    for i, j in np.ndindex(found.shape):
        if i != j:
            expected = segment_distance(segments[i], segments[j])
            assert found[i, j] == pytest.approx(expected, abs=1e-6)


@given(_points, _points, _points)
def test_point_distances(point, p, q):
    point, p, q = np.array([point, p, q])
    t = np.linspace(0, 1, 200)[:, None]
    sampled = np.linalg.norm((1 - t) * p + t * q - point, axis=1).min()
    spacing = np.linalg.norm(q - p) / 199
    assert sampled - spacing <= point_distances(point, p, q) + 1e-6 <= sampled + 2e-6


def test_layout_of_the_reference_track():
    track = load_track("student-airrace")
    layout = Layout.of(track)
    np.testing.assert_allclose(layout.pylons.reshape(-1, 2), track.pylons()[:, :2], atol=1e-9)
    np.testing.assert_allclose(layout.middle, [gate.p_WG[:2] for gate in track.gates])
    np.testing.assert_allclose(np.rad2deg(layout.turns), [45] * 9 + [-45])
    root = np.sqrt(2)
    np.testing.assert_allclose(
        layout.lengths, [20, 15 * root, 20, 25 * root, 70, 30 * root, 30, 30 * root, 30, 30 * root]
    )


def test_straight_on_leads_through_the_next_gate():
    """Where the way straight on ends is ahead, and between the next two pylons."""
    layout = Layout.of(load_track("student-airrace"))
    for i, end in enumerate(layout.straight_ends):
        following = (i + 1) % len(layout.left)
        ahead = end - layout.middle[i]
        np.testing.assert_allclose(ahead / np.linalg.norm(ahead), layout.forward[i], atol=1e-9)
        right, left = layout.right[following], layout.left[following]
        share = np.linalg.norm(end - left) / np.linalg.norm(right - left)
        np.testing.assert_allclose(left + share * (right - left), end, atol=1e-9)
        assert 0.3 < share < 0.8
