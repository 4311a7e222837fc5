"""Draws pylons as shaded, banded cones."""

import numpy as np

from airrace.rendering.exposure import Thing
from airrace.rendering.pixels import fill_polygons
from airrace.rendering.projection import NEAR, SHIFT, clip_near, to_fixed, to_pixels
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
        self._feet = feet
        self.K = camera_info.K
        self.size = np.array([camera_info.width, camera_info.height])
        # Inward normals of the view's four sides, in C.
        w, h = camera_info.width, camera_info.height
        corners = np.array([[0, 0, 1], [w, 0, 1], [w, h, 1], [0, h, 1]], float) - [0.5, 0.5, 0]
        rays = corners @ np.linalg.inv(self.K).T
        sides = np.cross(rays, np.roll(rays, -1, axis=0))
        self.sides = sides / np.linalg.norm(sides, axis=1)[:, None]

    def look_from(self, X_WC, shifts) -> "PylonPainter":
        """Returns what draws the pylons as seen from a pose of the camera.

        Args:
            shifts: of the pylons from their places in the track, (n, 3) m.
        """
        return PylonPainter(self, self._feet + shifts, X_WC)


class PylonPainter:
    """Draws any pylon of a track, seen from one pose of the camera.

    Attributes:
        distance: of the pylons' axes, (n,) m.
        in_view: whether each may be in the picture, (n,).
    """

    def __init__(self, pylons: Pylons, feet, X_WC):
        """Args: feet: where the pylons stand now, (n, 3), world."""
        self._feet, self._size = feet, pylons.size
        R_CW = X_WC.rotation().matrix().T
        self._p_WC = X_WC.translation()
        self._P = pylons.K @ R_CW
        self._low, self._high = self._boxes(self._P)
        self.distance = np.hypot(*(self._feet - self._p_WC)[:, :2].T)
        # Spheres about the pylons decide which ones may be in view.
        middle = [0, 0, PYLON_HEIGHT / 2]
        p_C = (self._feet + middle - self._p_WC) @ R_CW.T
        radius = 1.05 * PYLON_HEIGHT / 2
        self.in_view = np.all(p_C @ pylons.sides.T > -radius, axis=1) & (p_C[:, 2] > -radius)

    def camera_is_inside(self) -> bool:
        """Whether the camera is inside a pylon."""
        i = np.argmin(self.distance)
        shape = _DETAIL[0][1]
        p = self._p_WC - self._feet[i]
        return bool(p[2] > 0 and np.all(shape.facet_normals @ p < shape.facet_offsets))

    def thing(self, i) -> Thing | None:
        """Returns the pylon with index i, None if it is not in the picture."""
        (x0, y0), (x1, y1) = self._low[i], self._high[i]
        if x0 >= x1 or y0 >= y1:
            return None
        return Thing((x0, y0, x1, y1), lambda out, box: self._paint(i, out, box))

    def _boxes(self, P):
        """Returns the pixels that the pylons can touch: first ones, and those beyond, (n, 2)."""
        hull_h = (self._feet[:, None] + _HULL - self._p_WC) @ P.T
        # Where its edges meet the near plane, a hull ends: if they do, between their ends.
        a, b = hull_h[:, _HULL_EDGES[:, 0]], hull_h[:, _HULL_EDGES[:, 1]]
        share = np.clip((NEAR - a[:, :, 2:]) / (b[:, :, 2:] - a[:, :, 2:] + 1e-12), 0.0, 1.0)
        points_h = np.concatenate([hull_h, a + share * (b - a)], axis=1)
        hidden = points_h[:, :, 2:] < NEAR - 1e-6
        pixels = to_pixels(np.maximum(points_h, [-np.inf, -np.inf, NEAR]))
        low = np.where(hidden, np.inf, pixels).min(axis=1) - _EDGE
        high = np.where(hidden, -np.inf, pixels).max(axis=1) + _EDGE + 1
        return (np.clip(f(a), 0, self._size).astype(int).tolist()
                for f, a in ((np.floor, low), (np.ceil, high)))

    def _paint(self, i, out, box):
        """Draws the pylon with index i over what is there, at least in a box."""
        distance = self.distance[i]
        shape = next(shape for limit, shape in _DETAIL if distance <= limit)
        p_WC = self._p_WC - self._feet[i]  # from here on, world is at its foot
        visible = shape.facet_normals @ p_WC > shape.facet_offsets
        facets = shape.facets[visible]
        veil = haze(distance)
        colors = (1 - veil) * shape.facet_colors[visible] + veil * np.array(HORIZON)
        vertices_h = (shape.vertices - p_WC) @ self._P.T
        depth = vertices_h[:, 2]
        if depth.max() < NEAR:
            return
        if depth.min() >= NEAR:
            pixels = to_pixels(vertices_h)
            corners = pixels[facets]
            seen = ((corners.max(axis=1) > np.subtract(box[:2], _EDGE))
                    & (corners.min(axis=1) < np.add(box[2:], _EDGE))).all(axis=1)
            polygons, colors = to_fixed(corners[seen]), colors[seen]
        else:
            clipped = (clip_near(vertices_h[facet]) for facet in facets)
            polygons = [to_fixed(to_pixels(polygon)) for polygon in clipped]
        fill_polygons(out, polygons, colors, SHIFT)
