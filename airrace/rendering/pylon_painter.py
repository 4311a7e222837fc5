"""Draws pylons as shaded, banded cones."""

import numpy as np

from airrace.rendering.pixels import fill_polygons
from airrace.rendering.projection import NEAR, SHIFT, clip_near, to_fixed, to_pixels
from airrace.rendering.pylon_shape import make_pylon_shape
from airrace.rendering.textures import HORIZON, haze
from airrace.track import PYLON_HEIGHT

# (up to this distance (m), with this polyhedron)
_DETAIL = (
    (15.0, make_pylon_shape(16, 3)),
    (40.0, make_pylon_shape(12, 1)),
    (np.inf, make_pylon_shape(6, 0)),
)
_EDGE = 2.0  # px, wider than a smooth edge


class PylonPainter:
    """Draws any pylon of a track.

    Call look_from() once a picture, then paint() for one pylon after the other.
    """

    def __init__(self, feet, camera_info):
        """Constructs the painter.

        Args:
            feet: where the pylons stand, (n, 3), world.
            camera_info: calibration.
        """
        self._feet = self._places = feet
        self._K = camera_info.K
        self._beyond = np.array([camera_info.width, camera_info.height]) + _EDGE
        # Inward normals of the view's four sides, in C.
        w, h = camera_info.width, camera_info.height
        corners = np.array([[0, 0, 1], [w, 0, 1], [w, h, 1], [0, h, 1]], float) - [0.5, 0.5, 0]
        rays = corners @ np.linalg.inv(self._K).T
        sides = np.cross(rays, np.roll(rays, -1, axis=0))
        self._sides = sides / np.linalg.norm(sides, axis=1)[:, None]

    def move(self, shifts) -> None:
        """Moves the pylons by shifts, (n, 3) m, from where they were at first."""
        self._feet = self._places + shifts

    def look_from(self, X_WC) -> None:
        """Takes the pose of the camera for the next picture."""
        R_CW = X_WC.rotation().matrix().T
        self._p_WC = X_WC.translation()
        self._P = self._K @ R_CW
        self.distance = np.hypot(*(self._feet - self._p_WC)[:, :2].T)
        # Spheres about the pylons decide which ones may be in view.
        middle = [0, 0, PYLON_HEIGHT / 2]
        p_C = (self._feet + middle - self._p_WC) @ R_CW.T
        radius = 1.05 * PYLON_HEIGHT / 2
        self.in_view = np.all(p_C @ self._sides.T > -radius, axis=1) & (p_C[:, 2] > -radius)

    def camera_is_inside(self) -> bool:
        """Whether the camera is inside a pylon."""
        i = np.argmin(self.distance)
        shape = _DETAIL[0][1]
        p = self._p_WC - self._feet[i]
        return bool(p[2] > 0 and np.all(shape.facet_normals @ p < shape.facet_offsets))

    def paint(self, i, out) -> None:
        """Draws the pylon with index i over what is there."""
        if not self.in_view[i]:
            return
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
            if (pixels.max(axis=0) < -_EDGE).any() or (pixels.min(axis=0) > self._beyond).any():
                return
            polygons = to_fixed(pixels)[facets]
        else:
            clipped = (clip_near(vertices_h[facet]) for facet in facets)
            polygons = [to_fixed(to_pixels(polygon)) for polygon in clipped]
        fill_polygons(out, polygons, colors, SHIFT)
