"""Lens distortion, plumb-bob model (Brown 1966), as in OpenCV and ROS."""

import dataclasses as dc
from typing import TYPE_CHECKING

import cv2
import numpy as np

from airrace.common.errors import UserError
from airrace.common.immutable import read_only
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
        self._u, self._v = u.astype(np.float32), v.astype(np.float32)

    def source(self, box: Box, size: tuple[int, int]) -> Box:
        """Returns the box of a source of a size (w, h) that a box of the picture shows."""
        w, h = size
        u, v = _rim(crop(self._u, box)), _rim(crop(self._v, box))
        # Two pixels at least for interpolation.
        ends = u.min(), v.min(), u.max() + 2, v.max() + 2
        x0, y0, x1, y1 = (max(int(end), 0) for end in ends)
        # Whole fours, as the background is drawn.
        return Box(x0 // 4 * 4, y0, min(-(-x1 // 4) * 4, w), min(y1, h))

    def bend(self, source: np.ndarray, out: np.ndarray, box: Box | None = None) -> None:
        """Draws the picture, or a box of it; black and opaque where the source ends.

        Args: source, out: RGBA or grey levels, see images.py. box: None: all of it.
        """
        box = whole_box(out) if box is None else box
        cv2.remap(
            source,
            crop(self._u, box),
            crop(self._v, box),
            cv2.INTER_LINEAR,
            dst=crop(out, box),
            borderValue=(0, 0, 0, 255),
        )


def _rim(values: np.ndarray) -> np.ndarray:
    """Returns the rows and columns around an array: the least and the greatest are there."""
    return np.concatenate([values[0], values[-1], values[:, 0], values[:, -1]])


class Lens:
    """Bends pinhole pictures as a lens does.

    Attributes:
        pinhole: CameraInfo of the pictures it takes: undistorted, with the same
            focal length, and large enough to hold all that the lens sees.
        distortion: PixelMap from those to the lens's.
    """

    def __init__(self, camera_info: "CameraInfo"):
        """Raises UserError if D does not map rays to pixels one to one."""
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
