import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.trajopt.body_frames import BodyFrames
from airrace.visualization.arrows import X_COLOR, Z_COLOR, arrows, frame_arrows

_number = st.floats(-1.0, 1.0)
_vectors = st.lists(
    st.tuples(_number, _number, _number).filter(lambda v: np.linalg.norm(v) > 0.1),
    min_size=1,
    max_size=5,
)


@given(_vectors)
def test_an_arrow_goes_from_its_start_along_its_direction(vectors):
    directions = np.array([v / np.linalg.norm(v) for v in vectors]).T
    starts = 100.0 * np.array(vectors).T
    vertices, faces = arrows(starts, directions)
    n = len(vectors)
    assert vertices.shape == (3, 10 * n) and faces.shape == (3, 15 * n)
    corners = (vertices - np.repeat(starts, 10, axis=1)).T.reshape(n, 10, 3)
    along = np.einsum("nij,jn->ni", corners, directions)
    # Nothing is behind the start, the tip is the farthest, and it is on the axis.
    assert along.min() > -1e-9 and np.all(along.argmax(axis=1) == 9)
    np.testing.assert_allclose(corners[:, 9], 1.5 * directions.T, atol=1e-9)
    # The foot is around the start.
    np.testing.assert_allclose(corners[:, :3].mean(axis=1), 0.0, atol=1e-9)


@pytest.mark.parametrize("direction", np.vstack([np.eye(3), -np.eye(3)]))
def test_faces_look_outwards(direction):
    vertices, faces = arrows(np.zeros((3, 1)), direction[:, None])
    edges = {}
    for a, b, c in faces.T:
        for edge in ((a, b), (b, c), (c, a)):
            edges[edge] = edges.get(edge, 0) + 1
    # Neighbours turn the same way; only the three edges of the foot have none.
    assert max(edges.values()) == 1
    assert sum((b, a) not in edges for a, b in edges) == 3
    corners = vertices.T[faces.T]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    middles = corners.mean(axis=1)
    outward = middles - np.outer(middles @ direction, direction)
    is_back = np.abs(normals @ direction) > 0.999 * np.linalg.norm(normals, axis=1)
    assert np.all(np.sum(normals * outward, axis=1)[~is_back] > 0.0)
    assert is_back.sum() == 6 and np.all(normals[is_back] @ direction < 0.0)


def test_x_is_red_and_z_is_blue():
    frames = BodyFrames(np.zeros((3, 2)), np.eye(3)[:, [0, 1]], np.eye(3)[:, [2, 2]])
    vertices, _, colors = frame_arrows(frames)
    tips, paint = vertices[:, 9::10].T, colors[:, 9::10].T
    np.testing.assert_allclose(tips, 1.5 * np.eye(3)[[0, 1, 2, 2]], atol=1e-12)
    np.testing.assert_allclose(paint, [X_COLOR, X_COLOR, Z_COLOR, Z_COLOR])
