import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from airrace.track.geometry import point_distances, segment_distances

_points = st.tuples(st.floats(-10, 10), st.floats(-10, 10))
_segments = st.lists(st.tuples(_points, _points), min_size=2, max_size=6)


@given(_segments)
def test_segment_distances(segments):
    """Symmetric, and never above what sampling finds."""
    starts, ends = np.array(segments).transpose(1, 0, 2)
    found = segment_distances(starts, ends)
    np.testing.assert_allclose(found, found.T)
    t = np.linspace(0, 1, 60)[:, None, None]
    points = (1 - t) * starts + t * ends  # (60, n, 2)
    lengths = np.linalg.norm(ends - starts, axis=1)
    for i, j in itertools.permutations(range(len(segments)), 2):
        sampled = np.linalg.norm(points[:, None, i] - points[None, :, j], axis=2).min()
        spacing = (lengths[i] + lengths[j]) / 59
        assert sampled - spacing <= found[i, j] + 1e-6 <= sampled + 2e-6


@given(_points, _points, _points)
def test_point_distances(point, p, q):
    point, p, q = np.array([point, p, q])
    t = np.linspace(0, 1, 200)[:, None]
    sampled = np.linalg.norm((1 - t) * p + t * q - point, axis=1).min()
    spacing = np.linalg.norm(q - p) / 199
    assert sampled - spacing <= point_distances(point, p, q) + 1e-6 <= sampled + 2e-6
