import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from airrace.visualization.tubes import tube

_points = st.lists(st.tuples(*3 * [st.floats(-100.0, 100.0)]), min_size=2, max_size=12)


@given(_points)
def test_all_vertices_are_a_radius_from_their_point(points):
    vertices, faces = tube(points, 0.1)
    n = len(points)
    assert vertices.shape == (3, 3 * n) and faces.shape == (3, 6 * (n - 1))
    assert faces.min() == 0 and faces.max() == 3 * n - 1
    offsets = vertices.T.reshape(n, 3, 3) - np.array(points)[:, None]
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=2), 0.1, atol=1e-9)


def test_the_tube_of_a_straight_path_is_closed_around_it():
    vertices, faces = tube([[0, 0, 0], [1, 0, 0], [2, 0, 0]], 0.1)
    edges = {}
    for a, b, c in faces.T:
        for edge in ((a, b), (b, c), (c, a)):
            edges[frozenset(edge)] = edges.get(frozenset(edge), 0) + 1
    # Only the three edges at each end belong to one face.
    assert sorted(edges.values()).count(1) == 6 and max(edges.values()) == 2
    corners = vertices.T[faces.T]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outward = corners.mean(axis=1) * [0.0, 1.0, 1.0]
    assert np.all(np.sum(normals * outward, axis=1) > 0.0)
    np.testing.assert_allclose(vertices[:, 0::3].T[:, 2], 0.1)  # an edge on top


def test_a_path_straight_up_has_a_tube():
    vertices, _ = tube([[0, 0, 0], [0, 0, 1]], 0.1)
    np.testing.assert_allclose(np.hypot(*vertices[:2]), 0.1)
