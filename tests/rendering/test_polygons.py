"""Convex polygons: how much they cover, where, and what the camera's plane leaves of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.rendering.polygons import (
    EXACT,
    NEAR,
    OVERLAPPING,
    clip_near,
    fill_convex,
    lay_over,
)

SIZE = 40
ALL = np.array([[0, 0, SIZE, SIZE]])
coordinates = st.floats(4.0, SIZE - 4.0)
angles = st.floats(0.0, 2 * np.pi)


def square(x, y, side, angle):
    c, s = np.cos(angle), np.sin(angle)
    half = side / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return half @ np.array([[c, s], [-s, c]]) + [x, y]


def drawn(corners, fade, boxes=ALL, channels=1):
    picture = np.zeros((SIZE, SIZE, channels), np.uint8)
    fill_convex(picture, np.array(corners, float), np.full(channels, 255.0), fade, boxes)
    return picture


@given(st.floats(12.0, 28.0), st.floats(12.0, 28.0), st.floats(0.2, 16.0), angles)
def test_what_is_covered_is_the_area_wherever_it_lies(x, y, side, angle):
    """Of squares smaller than a pixel, too."""
    picture = drawn(square(x, y, side, angle), EXACT)[..., 0] / 255
    # Pixels are taken as turned with the edges: they overlap, and leave gaps.
    tolerance = 0.3 + 0.07 * side
    assert picture.sum() == pytest.approx(side**2, abs=min(tolerance, 0.7 * side**2 + 0.05))
    if side > 1.0:
        v, u = np.mgrid[:SIZE, :SIZE]
        for axis, expected in ((u, x), (v, y)):
            assert (axis * picture).sum() / picture.sum() == pytest.approx(expected, abs=0.1)


@given(coordinates, coordinates, st.floats(2.0, 16.0), angles)
def test_either_way_round(x, y, side, angle):
    corners = square(x, y, side, angle)
    np.testing.assert_array_equal(drawn(corners, EXACT), drawn(corners[::-1], EXACT))


@given(coordinates, coordinates, st.floats(0.5, 30.0), angles,
       st.sampled_from([EXACT, OVERLAPPING]),
       st.integers(1, SIZE - 1), st.integers(1, SIZE - 1))
def test_pieces_are_those_of_the_whole(x, y, side, angle, fade, column, row):
    corners = square(x, y, side, angle)
    boxes = np.array([
        [0, 0, column, row], [column, 0, SIZE, row], [0, row, column, SIZE],
        [column, row, SIZE, SIZE],
    ])
    np.testing.assert_array_equal(drawn(corners, fade, boxes), drawn(corners, fade))
    assert not drawn(corners, fade, boxes[:1])[row:].any()


@given(st.floats(8.0, 32.0), angles, st.integers(0, 2))
def test_no_seam_between_facets_of_one_body(x, angle, channel):
    """Nothing behind a body shines through where two of its facets meet."""
    left = square(x, 20.0, 60.0, angle) - 30.0 * np.array([np.cos(angle), np.sin(angle)])
    right = square(x, 20.0, 60.0, angle) + 30.0 * np.array([np.cos(angle), np.sin(angle)])
    picture = np.zeros((SIZE, SIZE, 3), np.uint8)
    for corners in (left, right):
        fill_convex(picture, corners, np.full(3, 200.0), OVERLAPPING, ALL)
    assert picture[10:30, 10:30, channel].min() >= 199


def test_channels_have_their_colours():
    picture = np.zeros((SIZE, SIZE, 4), np.uint8)
    fill_convex(picture, square(20.0, 20.0, 9.0, 0.0), np.array([10.0, 20.0, 30.0, 255.0]),
                EXACT, ALL)
    np.testing.assert_array_equal(picture[20, 20], [10, 20, 30, 255])
    assert not picture[5, 5].any()


def test_degenerate_polygons_draw_next_to_nothing():
    for corners in (square(20.0, 20.0, 0.0, 0.3), [[3.0, 3.0], [3.0, 3.0], [30.0, 3.0]]):
        assert drawn(corners, EXACT).astype(float).sum() < 255 * SIZE


def test_a_picture_is_laid_over_where_the_polygon_is():
    levels = np.arange(100, dtype=np.uint8).reshape(10, 10)
    picture = np.full((SIZE, SIZE, 4), 255, np.uint8)
    lay_over(picture, levels, np.array([15, 12]), square(20.0, 17.0, 6.0, 0.0), ALL)
    np.testing.assert_array_equal(picture[17, 18:22, 0], levels[5, 3:7])
    np.testing.assert_array_equal(picture[17, 18:22, 2], levels[5, 3:7])
    assert np.all(picture[..., 3] == 255) and np.all(picture[:12] == 255)


depths = st.lists(st.floats(-2.0, 2.0), min_size=4, max_size=4)


@given(depths, st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_what_the_near_plane_leaves(depths, x, y):
    points = np.array([[x - 1, y - 1, 0], [x + 1, y - 1, 0], [x + 1, y + 1, 0], [x - 1, y + 1, 0]])
    points = points.astype(float)
    points[:, 2] = depths
    clipped = np.full((8, 2), np.nan)
    count = clip_near(points, clipped)
    before = points[:, 2] >= NEAR
    crossings = int(np.sum(before != np.roll(before, -1)))
    assert count == before.sum() + crossings
    assert np.isfinite(clipped[:count]).all()
    for k, point in enumerate(points[before] if crossings == 0 else []):
        np.testing.assert_allclose(clipped[k], point[:2] / point[2])
