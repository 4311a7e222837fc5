"""Shadows lie where the sun casts them."""

import numpy as np

from airrace.rendering.scene.shadows import cast, pylon_shadow
from airrace.rendering.scene.textures import SUN_W
from airrace.track import BOARD_HEIGHT, PYLON_HEIGHT
from tests.worlds.pictures import one_gate

TRACK = one_gate()
FOOT = TRACK.pylons()[0]
BOARDS = TRACK.boards()[:2]


def opacity(vertices, image, xy):
    """Returns what is drawn at a point of the ground relative to the foot."""
    low, high = vertices[0, :2], vertices[2, :2]
    x, y = (np.array(xy) - low) / (high - low)
    rows, columns = image.shape[:2]
    return image[int((1 - y) * rows), int(x * columns), 3]


def test_rays_go_along_the_sun():
    points = np.random.default_rng(0).uniform(0, 10, (20, 3))
    ways = np.column_stack([cast(points), np.zeros(20)]) - points
    np.testing.assert_allclose(np.cross(ways, SUN_W), 0, atol=1e-9)
    assert np.all(ways @ SUN_W < 0)


def test_shadow_of_a_pylon():
    vertices, image = pylon_shadow(FOOT, BOARDS)
    away = -SUN_W[:2] / np.linalg.norm(SUN_W[:2])
    across = np.array([-away[1], away[0]])
    length = PYLON_HEIGHT * np.linalg.norm(SUN_W[:2]) / SUN_W[2]
    dark = opacity(vertices, image, [0, 0])
    assert dark > 60
    for share in (0.3, 0.6, 0.9):
        assert opacity(vertices, image, share * length * away) == dark
    assert opacity(vertices, image, (length + 0.3) * away) == 0
    for side in (-1, 1):
        assert opacity(vertices, image, 0.8 * length * away + 1.2 * side * across) == 0
    # The boards stick out on either side.
    for board in BOARDS:
        corner = (board.X_WM @ [[0.55, -0.55], [0, 0], [0, 0]]).T - FOOT
        assert min(opacity(vertices, image, xy) for xy in cast(corner)) > 0.9 * dark
    assert BOARDS[0].X_WM.translation()[2] == BOARD_HEIGHT


def test_the_picture_ends_in_the_sun():
    """Its margin is transparent, so its rectangle does not show."""
    vertices, image = pylon_shadow(FOOT, BOARDS)
    alpha = image[..., 3]
    for margin in (alpha[0], alpha[-1], alpha[:, 0], alpha[:, -1]):
        assert not margin.any()
    assert np.all(vertices[:, 2] > 0) and np.all(vertices[:, 2] < 0.1)
