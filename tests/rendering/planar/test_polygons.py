"""Convex polygons: how much they cover, where, and what the camera's plane leaves of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.common.jit import compiled
from airrace.rendering.images import Box, touches
from airrace.rendering.planar.marker_face import FACE
from airrace.rendering.planar.polygons import (
    EXACT,
    OVERLAPPING,
    POLYGON,
    WHOLE,
    DisplayList,
    end_at_seam,
    paint,
    set_polygon,
)
from airrace.rendering.planar.projection import NEAR, bounding_box, clip_near

SIZE = 40
ALL = np.array([[0, 0, SIZE, SIZE]])
ALL_SHARES = np.array([WHOLE], np.uint16)
coordinates = st.floats(4.0, SIZE - 4.0)
angles = st.floats(0.0, 2 * np.pi)


def square(x, y, side, angle):
    c, s = np.cos(angle), np.sin(angle)
    half = side / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return half @ np.array([[c, s], [-s, c]]) + [x, y]


def add(polygons, corners, end, color, seam=None):
    """Appends a POLYGON to a list."""
    polygon, corners = np.zeros(1, POLYGON), np.array(corners, float)
    set_compiled(polygon, corners, end, np.array(color, float), Box(0, 0, SIZE, SIZE))
    if seam is not None:
        end_compiled(polygon, seam)
    polygons.append(polygon)


@compiled
def set_compiled(polygon, corners, end, color, box):
    box = bounding_box(corners, len(corners), box)
    set_polygon(polygon[0], corners, len(corners), end, color, box)


@compiled
def end_compiled(polygon, seam):
    end_at_seam(polygon[0], seam)


def display_list(*exposures):
    """Returns a DisplayList of lists of polygons."""
    polygons = np.concatenate([polygon for exposure in exposures for polygon in exposure])
    starts = np.cumsum([0, *map(len, exposures)])
    return DisplayList(polygons, np.zeros(len(polygons), FACE), starts)


def listed(pictures, end, level=255.0):
    """Returns a DisplayList of pictures, each of which is a list of corners."""
    exposures = []
    for picture in pictures:
        exposures.append([])
        for corners in picture:
            add(exposures[-1], corners, end, np.full(5, level))
    return display_list(*exposures)


def drawn(corners, end, boxes=ALL, channels=1):
    picture = np.zeros((SIZE, SIZE, channels), np.uint8)
    paint(picture, boxes, listed([[corners]], end), ALL_SHARES)
    return picture


@pytest.mark.slow
@given(st.floats(12.0, 28.0), st.floats(12.0, 28.0), st.floats(0.2, 16.0), angles)
def test_what_is_covered_is_the_area_wherever_it_lies(x, y, side, angle):
    """Of squares smaller than a pixel, too."""
    picture = drawn(square(x, y, side, angle), EXACT)[..., 0] / 255
    # Pixels are taken as turned with the edges: they overlap, and leave gaps, most of all
    # along diagonals.
    tolerance = 0.3 + 0.24 * side
    assert picture.sum() == pytest.approx(side**2, abs=min(tolerance, 0.7 * side**2 + 0.05))
    if side > 1.0:
        v, u = np.mgrid[:SIZE, :SIZE]
        for axis, expected in ((u, x), (v, y)):
            assert (axis * picture).sum() / picture.sum() == pytest.approx(expected, abs=0.1)


@pytest.mark.slow
@given(coordinates, coordinates, st.floats(2.0, 16.0), angles)
def test_either_way_round(x, y, side, angle):
    corners = square(x, y, side, angle)
    np.testing.assert_array_equal(drawn(corners, EXACT), drawn(corners[::-1], EXACT))


@given(
    coordinates,
    coordinates,
    st.floats(0.5, 30.0),
    angles,
    st.sampled_from([EXACT, OVERLAPPING]),
    st.integers(1, SIZE - 1),
    st.integers(1, SIZE - 1),
)
def test_pieces_are_those_of_the_whole(x, y, side, angle, end, column, row):
    corners = square(x, y, side, angle)
    boxes = np.array(
        [
            [0, 0, column, row],
            [column, 0, SIZE, row],
            [0, row, column, SIZE],
            [column, row, SIZE, SIZE],
        ]
    )
    np.testing.assert_array_equal(drawn(corners, end, boxes), drawn(corners, end))
    assert not drawn(corners, end, boxes[:1])[row:].any()


@given(st.floats(8.0, 32.0), angles, st.integers(0, 2))
def test_no_seam_between_facets_of_one_body(x, angle, channel):
    """Nothing behind a body shines through where two of its facets meet."""
    left = square(x, 20.0, 60.0, angle) - 30.0 * np.array([np.cos(angle), np.sin(angle)])
    right = square(x, 20.0, 60.0, angle) + 30.0 * np.array([np.cos(angle), np.sin(angle)])
    picture = np.zeros((SIZE, SIZE, 3), np.uint8)
    paint(picture, ALL, listed([[left, right]], OVERLAPPING, 200.0), ALL_SHARES)
    assert picture[10:30, 10:30, channel].min() >= 199


@given(st.floats(8.0, 32.0), angles)
def test_facets_that_end_at_a_seam_do_not_fade_there(x, angle):
    """A pixel where two facets meet shows one of them."""
    c, s = np.cos(angle), np.sin(angle)
    polygons = []
    for side, level, edge in ((-1, 100.0, 1), (1, 200.0, 3)):
        corners = square(x, 20.0, 60.0, angle) + side * 30.0 * np.array([c, s])
        add(polygons, corners, OVERLAPPING, np.full(5, level), edge)
    picture = np.zeros((SIZE, SIZE, 1), np.uint8)
    paint(picture, ALL, display_list(polygons), ALL_SHARES)
    v, u = np.mgrid[10:30, 10:30]
    beyond = c * (u - x) + s * (v - 20.0)
    shown = picture[10:30, 10:30, 0]
    assert (shown[beyond < -1e-4] == 100).all() and (shown[beyond > 1e-4] == 200).all()
    assert shown.min() >= 100


def test_channels_have_their_colours():
    polygons, color = [], np.array([10.0, 20.0, 30.0, 255.0, 77.0])
    add(polygons, square(20.0, 20.0, 9.0, 0.0), EXACT, color)
    for channels, expected in ((4, color[:4]), (1, color[4:])):
        picture = np.zeros((SIZE, SIZE, channels), np.uint8)
        paint(picture, ALL, display_list(polygons), ALL_SHARES)
        np.testing.assert_array_equal(picture[20, 20], expected)
        assert not picture[5, 5].any()


@given(
    coordinates,
    coordinates,
    coordinates,
    coordinates,
    st.integers(1, WHOLE - 1),
    st.sampled_from([1, 4]),
)
def test_mean_of_pictures(x, y, u, v, share, channels):
    """It is as if they were painted one by one, to half a grey level of rounding."""
    behind = np.random.default_rng(3).integers(0, 256, (SIZE, SIZE, channels), dtype=np.uint8)
    pictures = [[square(x, y, 9.0, 0.3)], [square(u, v, 11.0, 1.0), square(x, v, 5.0, 0.0)]]
    expected = np.zeros(behind.shape)
    for part, picture in zip((share, WHOLE - share), pictures):
        one = behind.copy()
        paint(one, ALL, listed([picture], EXACT, 40.0), ALL_SHARES)
        expected += part / WHOLE * one
    mean = behind.copy()
    paint(mean, ALL, listed(pictures, EXACT, 40.0), np.array([share, WHOLE - share], np.uint16))
    assert np.abs(mean - expected).max() <= 0.5


def test_degenerate_polygons_draw_next_to_nothing():
    for corners in (square(20.0, 20.0, 0.0, 0.3), [[3.0, 3.0], [3.0, 3.0], [30.0, 3.0]]):
        assert drawn(corners, EXACT).astype(float).sum() < 255 * SIZE


depths = st.lists(st.floats(-2.0, 2.0), min_size=4, max_size=4)


@given(depths, st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_what_the_near_plane_leaves(depths, x, y):
    points = np.array([[x - 1, y - 1, 0], [x + 1, y - 1, 0], [x + 1, y + 1, 0], [x - 1, y + 1, 0]])
    points = points.astype(float)
    points[:, 2] = depths
    clipped = np.full((8, 2), np.nan)
    count = clip_near(points, np.arange(4), clipped)
    before = points[:, 2] >= NEAR
    crossings = int(np.sum(before != np.roll(before, -1)))
    assert count == before.sum() + crossings
    assert np.isfinite(clipped[:count]).all()
    for k, point in enumerate(points[before] if crossings == 0 else []):
        np.testing.assert_allclose(clipped[k], point[:2] / point[2])


@given(
    st.lists(st.integers(0, 5), min_size=4, max_size=4),
    st.lists(st.lists(st.integers(0, 5), min_size=4, max_size=4), max_size=3),
)
def test_boxes_touch_if_they_share_a_pixel(box, others):
    def pixels(box):
        x0, y0, x1, y1 = box
        return {(x, y) for x in range(x0, x1) for y in range(y0, y1)}

    shared = any(pixels(box) & pixels(other) for other in others)
    assert touches(Box(*box), np.reshape(np.array(others, int), (-1, 4))) == shared
