"""Draws pylons as shaded, banded cones."""

import functools
import math

import numpy as np

from airrace.compiled import compiled
from airrace.rendering.pixels import colors_for
from airrace.rendering.polygons import NEAR, OVERLAPPING, clip_near, fill_convex
from airrace.rendering.pylon_shape import make_pylon_shape
from airrace.rendering.textures import HORIZON, haze
from airrace.track import PYLON_BASE_RADIUS, PYLON_HEIGHT, PYLON_TIP_RADIUS

# (up to this distance (m), with this polyhedron)
_DETAIL = (
    (15.0, make_pylon_shape(16, 3)),
    (40.0, make_pylon_shape(12, 1)),
    (np.inf, make_pylon_shape(6, 0)),
)
_EDGE = 2.0  # px, wider than a smooth edge
# Corners of a frustum that holds a pylon whatever its detail.
_HULL = np.array([
    [1.1 * x * r, 1.1 * y * r, z] for x in (-1, 1) for y in (-1, 1)
    for r, z in ((PYLON_BASE_RADIUS, 0.0), (PYLON_TIP_RADIUS, PYLON_HEIGHT))
])
_HULL_EDGES = np.array([[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [2, 6], [6, 4], [4, 0],
                        [1, 3], [3, 7], [7, 5], [5, 1]])


class Pylons:
    """The pylons of a track, for a camera."""

    def __init__(self, feet, camera_info):
        """Constructs them.

        Args:
            feet: where the pylons stand, (n, 3), world.
            camera_info: calibration.
        """
        self.feet = feet
        self.K = camera_info.K
        self.size = np.array([camera_info.width, camera_info.height])

    def look_from(self, X_WC, shifts) -> "PylonPainter":
        """Returns what draws the pylons as seen from a pose of the camera.

        Args:
            shifts: of the pylons from their places in the track, (n, 3) m.
        """
        return PylonPainter(self, self.feet + shifts, X_WC)


class PylonPainter:
    """Draws any pylon of a track, seen from one pose of the camera.

    Attributes:
        distance: of the pylons' axes, (n,) m.
        boxes: the pixels that each can touch, see pixels.py, (n, 4); empty if it
            is out of sight.
    """

    def __init__(self, pylons: Pylons, feet, X_WC):
        """Args: feet: where the pylons stand now, (n, 3), world."""
        self._p_CF_W = feet - X_WC.translation()
        self._P = pylons.K @ X_WC.rotation().matrix().T
        self.distance = np.hypot(self._p_CF_W[:, 0], self._p_CF_W[:, 1])
        self.boxes = _boxes(self._p_CF_W, self._P, pylons.size)

    def camera_is_inside(self) -> bool:
        """Whether the camera is inside a pylon."""
        i = np.argmin(self.distance)
        if self.distance[i] > 2 * PYLON_BASE_RADIUS:
            return False
        shape = _DETAIL[0][1]
        p = -self._p_CF_W[i]
        return bool(p[2] > 0 and np.all(shape.facet_normals @ p < shape.facet_offsets))

    def paint(self, i, out, boxes) -> None:
        """Draws the pylon with index i over what is there, in boxes of a picture.

        Args:
            out: (h, w, channels). boxes: see pixels.py, (n, 4).
        """
        level = next(k for k, (limit, _) in enumerate(_DETAIL) if self.distance[i] <= limit)
        _paint(out, boxes, self._p_CF_W[i], self._P, *_solid(level), *_coat(level, out.shape[2]),
               haze(self.distance[i]))


@functools.cache
def _solid(level) -> tuple:
    """Returns what _paint() needs to know of a polyhedron, without its colours."""
    shape = _DETAIL[level][1]
    return (np.ascontiguousarray(shape.vertices), np.ascontiguousarray(shape.facets),
            np.ascontiguousarray(shape.facet_normals), np.ascontiguousarray(shape.facet_offsets))


@functools.cache
def _coat(level, channels) -> tuple:
    """Returns the colours of a polyhedron's facets, and of the haze before them."""
    return (colors_for(channels, _DETAIL[level][1].facet_colors),
            colors_for(channels, [HORIZON])[0])


@compiled
def _boxes(p_CF_W, P, size):
    """Returns the boxes of pylons at these feet; see PylonPainter."""
    boxes = np.zeros((len(p_CF_W), 4), np.int64)
    hull = np.empty((len(_HULL), 3))
    for i in range(len(p_CF_W)):
        nearest = np.inf
        for k in range(len(_HULL)):
            for row in range(3):
                hull[k, row] = 0.0
                for j in range(3):
                    hull[k, row] += P[row, j] * (p_CF_W[i, j] + _HULL[k, j])
            nearest = min(nearest, hull[k, 2])
        u0, v0, u1, v1 = np.inf, np.inf, -np.inf, -np.inf
        for h in hull:
            if h[2] >= NEAR:
                u, v = h[0] / h[2], h[1] / h[2]
                u0, v0, u1, v1 = min(u0, u), min(v0, v), max(u1, u), max(v1, v)
        if nearest < NEAR:
            # Where its edges meet the near plane, the hull ends.
            for k in range(len(_HULL_EDGES)):
                a, b = hull[_HULL_EDGES[k, 0]], hull[_HULL_EDGES[k, 1]]
                if (a[2] >= NEAR) != (b[2] >= NEAR):
                    share = (NEAR - a[2]) / (b[2] - a[2])
                    u = (a[0] + share * (b[0] - a[0])) / NEAR
                    v = (a[1] + share * (b[1] - a[1])) / NEAR
                    u0, v0, u1, v1 = min(u0, u), min(v0, v), max(u1, u), max(v1, v)
        w, h = size
        if u0 < w + _EDGE and v0 < h + _EDGE and u1 > -_EDGE and v1 > -_EDGE:
            boxes[i, 0] = int(max(math.floor(u0 - _EDGE), 0.0))
            boxes[i, 1] = int(max(math.floor(v0 - _EDGE), 0.0))
            boxes[i, 2] = int(min(math.ceil(u1 + _EDGE + 1.0), w))
            boxes[i, 3] = int(min(math.ceil(v1 + _EDGE + 1.0), h))
    return boxes


@compiled
def _paint(out, boxes, p_CF_W, P, vertices, facets, normals, offsets, colors, horizon, veil):
    """Draws a pylon.

    Args:
        p_CF_W: from the camera to its foot, (3,).
        P: K R_CW.
        vertices, facets, normals, offsets: see PylonShape.
        colors: of the facets, (f, channels).
        horizon: colour of the haze, (channels,).
        veil: share of it.
    """
    projected = np.empty((len(vertices), 3))
    for k in range(len(vertices)):
        for row in range(3):
            projected[k, row] = 0.0
            for j in range(3):
                projected[k, row] += P[row, j] * (p_CF_W[j] + vertices[k, j])
    corners_h, corners = np.empty((4, 3)), np.empty((5, 2))
    color = np.empty(out.shape[2])
    for f in range(len(facets)):
        facing = 0.0
        for j in range(3):
            facing -= normals[f, j] * p_CF_W[j]
        if facing <= offsets[f]:
            continue
        for k in range(4):
            corners_h[k] = projected[facets[f, k]]
        count = clip_near(corners_h, corners)
        if count > 0:
            for c in range(len(color)):
                color[c] = (1.0 - veil) * colors[f, c] + veil * horizon[c]
            fill_convex(out, corners[:count], color, OVERLAPPING, boxes)
