"""What lies between the camera and a thing, and behind all things."""

from typing import TYPE_CHECKING

import numpy as np

from airrace.rendering.images import LUMA, to_grey, with_channels
from airrace.rendering.planar.background import Background
from airrace.rendering.scene.textures import HAZE_LENGTH, HORIZON, haze

if TYPE_CHECKING:
    from pydrake.math import RigidTransform

    from airrace.vehicle.camera_info import CameraInfo

_MOST = 10.0  # lengths of the haze, beyond which it is as thick as it gets
_ENTRIES = 8192  # of the look-up tables over the distance
_ONE, _HALF = 256, 128  # what shares are counted in
_WEIGHTS = np.round(_ONE * LUMA).astype(np.uint32)


class Atmosphere:
    """Adds haze and sky to a picture whose depths are known."""

    def __init__(self, camera_info: "CameraInfo"):
        self._background = Background(camera_info)
        K = camera_info.K
        x = (np.arange(camera_info.width) - K[0, 2]) / K[0, 0]
        y = (np.arange(camera_info.height) - K[1, 2]) / K[1, 1]
        # Times the depth, this is the entry in the tables.
        lengths = np.hypot(np.hypot(x[None, :], y[:, None]), 1) / HAZE_LENGTH
        self._rate = np.float32(lengths * _ENTRIES / _MOST)
        veil = haze((np.arange(_ENTRIES + 1) + 0.5) * _MOST / _ENTRIES * HAZE_LENGTH)
        # What is left of a thing's colour, and what the haze adds to it: RGB, and grey.
        self._clear = np.round(_ONE * (1.0 - veil)).astype(np.uint32)
        horizon = np.append(HORIZON, to_grey(HORIZON))
        self._veil = np.round(_ONE * veil[:, None] * horizon).astype(np.uint32)

    def apply(
        self, X_WC: "RigidTransform", depth: np.ndarray, picture: np.ndarray, out: np.ndarray
    ) -> None:
        """Adds them to a picture, RGBA, seen from X_WC, and draws the result.

        Args:
            depth: z of everything in C (m), (h, w), float32; infinite where there is nothing.
            out: RGBA or grey levels, see images.py; overwritten. It must not be the picture.
        """
        out, is_sky = with_channels(out), np.isinf(depth)
        rows = np.flatnonzero(is_sky.any(axis=1))
        if len(rows):
            box = (0, rows[0], out.shape[1], rows[-1] + 1)
            self._background.paint(out, [box], [(1.0, X_WC)])
        entries = np.minimum(depth * self._rate, _ENTRIES).astype(np.int32)[..., None]
        colors = picture[:, :, :3].astype(np.uint32)
        if out.shape[2] == 1:
            colors = (colors @ _WEIGHTS + _HALF)[..., None] >> 8
            veil = self._veil[entries, 3]
        else:
            veil = self._veil[entries, np.arange(3)]
        seen = (self._clear[entries] * colors + veil + _HALF) >> 8
        channels = seen.shape[2]
        out[:, :, :channels] = np.where(is_sky[..., None], out[:, :, :channels], seen)
        out[:, :, 3:] = 255
