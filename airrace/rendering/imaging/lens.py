"""Lens distortion, plumb-bob model (Brown 1966), as in OpenCV and ROS."""

import dataclasses as dc

import cv2
import numpy as np

from airrace.common.errors import UserError
from airrace.common.immutable import read_only
from airrace.rendering.imaging.pixel_maps import PixelMap


class Lens:
    """Bends pinhole pictures as a lens does.

    Attributes:
        pinhole: CameraInfo of the pictures it takes: undistorted, with the same
            focal length, and large enough to hold all that the lens sees.
        distortion: PixelMap from those to the lens's.
    """

    def __init__(self, camera_info):
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
        # Whole fours, in which pictures are drawn quickest.
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
