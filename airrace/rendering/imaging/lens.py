"""Lens distortion, plumb-bob model (Brown 1966), as in OpenCV and ROS."""

import dataclasses as dc
from typing import TYPE_CHECKING

import cv2
import numpy as np

from airrace.common.errors import UserError
from airrace.common.immutable import read_only
from airrace.common.jit import compiled
from airrace.rendering.images import Box, crop, whole_box

if TYPE_CHECKING:
    from airrace.vehicle.camera_info import CameraInfo


class PixelMap:
    """Where in a source each pixel of a picture comes from, interpolated bilinearly.

    Attributes:
        shape: of the picture, (h, w).
    """

    def __init__(self, u: np.ndarray, v: np.ndarray):
        """Args: u, v: the pixels of the source, (h, w); neighbours stay neighbours."""
        self.shape = u.shape
        # OpenCV bends grey pictures a tenth quicker by them than by its fixed-point maps.
        self._u, self._v = np.float32(u), np.float32(v)

    def source(self, box: Box, size: tuple[int, int]) -> Box:
        """Returns the box of the source that a box of the picture shows.

        Args:
            box: of the picture.
            size: of the source, (w, h).
        """
        w, h = size
        u0, v0, u1, v1 = _extent(self._u, self._v, Box(*box))
        # Two pixels at least for interpolation.
        x0, y0, x1, y1 = (max(int(end), 0) for end in (u0, v0, u1 + 2, v1 + 2))
        # Whole fours, as the background is drawn.
        return Box(x0 // 4 * 4, y0, min(-(-x1 // 4) * 4, w), min(y1, h))

    def bend(self, source: np.ndarray, out: np.ndarray, box: Box | None = None) -> None:
        """Draws the picture, or a box of it; black and opaque where the source ends.

        Args:
            source, out: RGBA or grey levels, see images.py.
            box: the part to draw; None: all of it.
        """
        box = whole_box(out) if box is None else box
        cv2.remap(
            source,
            crop(self._u, box),  # type: ignore[arg-type]
            crop(self._v, box),  # type: ignore[arg-type]
            cv2.INTER_LINEAR,
            dst=crop(out, box),
            borderValue=(0, 0, 0, 255),
        )


@compiled
def _extent(u, v, box):
    """Returns the least u and v and the greatest in a box: they are on its rim."""
    x0, y0, x1, y1 = box
    least_u, least_v, most_u, most_v = u[y0, x0], v[y0, x0], u[y0, x0], v[y0, x0]
    for y in range(y0, y1):
        for x in range(x0, x1, 1 if y == y0 or y == y1 - 1 else max(x1 - x0 - 1, 1)):
            least_u, most_u = min(least_u, u[y, x]), max(most_u, u[y, x])
            least_v, most_v = min(least_v, v[y, x]), max(most_v, v[y, x])
    return least_u, least_v, most_u, most_v


class Lens:
    """Bends pinhole pictures as a lens does.

    Attributes:
        pinhole: CameraInfo of the pictures it takes: undistorted, with the same
            focal length, and large enough to hold all that the lens sees.
        distortion: PixelMap from those to the lens's.
    """

    def __init__(self, camera_info: "CameraInfo"):
        """Constructs the lens of a camera.

        Args:
            camera_info: calibration with K and D.

        Raises:
            UserError: if D does not map rays to pixels one to one.
        """
        K, D = camera_info.K, camera_info.D
        w, h = camera_info.width, camera_info.height
        u, v = np.meshgrid(np.arange(w, dtype=float), np.arange(h, dtype=float))
        pixels = np.stack([u, v], axis=-1).reshape(-1, 1, 2)
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-9)
        rays = cv2.undistortPoints(pixels, K, D, criteria=criteria).reshape(-1, 2)
        _check(rays[::13], pixels.reshape(-1, 2)[::13], K, D)  # enough, and quick
        ideal = rays @ K[:2, :2].T + K[:2, 2]
        low = np.floor(ideal.min(axis=0)) - 1
        # Whole fours, as the background is drawn.
        width, height = (-4 * np.floor(-(ideal.max(axis=0) + 2 - low) / 4)).astype(int).tolist()
        K_pinhole = K - np.array([[0, 0, low[0]], [0, 0, low[1]], [0, 0, 0]])
        self.pinhole = dc.replace(
            camera_info,
            width=width,
            height=height,
            K=read_only(K_pinhole),
            D=read_only(np.zeros(5)),
            P=read_only(np.column_stack([K_pinhole, np.zeros(3)])),
        )
        self.distortion = PixelMap(*(ideal - low).T.reshape(2, h, w))


def _check(rays, pixels, K, D):
    """Raises UserError unless the rays belong to the pixels, and no others do."""
    k1, k2, _, _, k3 = D
    with np.errstate(all="ignore"):
        r2 = np.linspace(0.0, np.max(np.sum(rays * rays, axis=1)), 200)
        # The distorted radius r (1 + k1 r^2 + k2 r^4 + k3 r^6) must grow with r.
        growth = 1 + 3 * k1 * r2 + 5 * k2 * r2**2 + 7 * k3 * r2**3
    if np.all(growth > 0):  # NaN is not
        points = np.column_stack([rays, np.ones(len(rays))])
        zero = np.zeros(3)
        again = cv2.projectPoints(points, zero, zero, K, D)[0].reshape(-1, 2)
        if np.abs(again - pixels).max() < 0.01:
            return
    raise UserError(
        "camera.effects.distortion folds the picture's margin over: "
        "use smaller coefficients, or a smaller camera.fov_y_deg."
    )
