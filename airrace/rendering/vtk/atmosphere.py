"""What lies between the camera and a thing, and behind all things."""

from typing import TYPE_CHECKING

import numpy as np

from airrace.common.jit import compiled
from airrace.rendering.images import LUMA, to_grey, with_channels
from airrace.rendering.planar.background import Background
from airrace.rendering.scene.textures import HAZE_LENGTH, HORIZON, haze

if TYPE_CHECKING:
    from pydrake.math import RigidTransform

    from airrace.vehicle.camera_info import CameraInfo

_MOST = 10.0  # lengths of the haze, beyond which it is as thick as it gets
_ENTRIES = 8192  # of the look-up tables over the distance
_ONE = 256  # what shares are counted in
_WEIGHTS = tuple(int(weight) for weight in np.round(_ONE * LUMA))


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
        self._clear = np.uint32(np.round(_ONE * (1.0 - veil)))
        horizon = np.append(HORIZON, to_grey(HORIZON))
        self._veil = np.uint32(np.round(_ONE * veil[:, None] * horizon))

    def apply(
        self, X_WC: "RigidTransform", depth: np.ndarray, picture: np.ndarray, out: np.ndarray
    ) -> None:
        """Adds them.

        Args:
            X_WC: pose of the camera; z forward, x right, y down.
            depth: z of everything in C (m), (h, w), float32; infinite where
                there is nothing.
            picture: RGBA, (h, w, 4), uint8.
            out: RGBA or grey levels, see images.py; overwritten. It must not be the picture.
        """
        first, end = _sky_rows(depth)
        if first < end:
            self._background.paint(
                with_channels(out), [(0, first, out.shape[1], end)], [(1.0, X_WC)]
            )
        _apply(picture, depth, self._rate, self._clear, self._veil, with_channels(out))


@compiled
def _sky_rows(depth):
    """Returns the first row in which there is nothing somewhere, and the one after the last."""
    first, end = 0, len(depth)
    while first < end and not np.isinf(depth[first]).any():
        first += 1
    while first < end and not np.isinf(depth[end - 1]).any():
        end -= 1
    return first, end


@compiled
def _apply(picture, depth, rate, clear, veil, out):
    """See Atmosphere.apply(); out, (h, w, channels), keeps the sky that is in it."""
    h, w, channels = out.shape
    r, g, b = np.uint32(_WEIGHTS[0]), np.uint32(_WEIGHTS[1]), np.uint32(_WEIGHTS[2])
    last, half = np.float32(len(clear) - 1), np.uint32(_ONE // 2)
    for v in range(h):
        for u in range(w):
            if depth[v, u] == np.inf:
                continue
            i = np.int32(min(depth[v, u] * rate[v, u], last))
            share = clear[i]
            if channels == 1:
                level = (
                    r * picture[v, u, 0] + g * picture[v, u, 1] + b * picture[v, u, 2] + half
                ) >> np.uint32(8)
                out[v, u, 0] = np.uint8((share * level + veil[i, 3] + half) >> np.uint32(8))
                continue
            for c in range(3):
                level = np.uint32(picture[v, u, c])
                out[v, u, c] = np.uint8((share * level + veil[i, c] + half) >> np.uint32(8))
            out[v, u, 3] = 255
