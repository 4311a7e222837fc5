"""What lies between the camera and a thing, and behind all things."""

import cv2
import numpy as np

from airrace.rendering.background import Background
from airrace.rendering.textures import HAZE_LENGTH, HAZE_MOST, HORIZON


class Atmosphere:
    """Adds haze and sky to a picture whose depths are known."""

    def __init__(self, camera_info):
        self._background = Background(camera_info)
        K = camera_info.K
        x = (np.arange(camera_info.width) - K[0, 2]) / K[0, 0]
        y = (np.arange(camera_info.height) - K[1, 2]) / K[1, 1]
        # Times the depth, this is the exponent of haze().
        self._rate = np.float32(-np.hypot(np.hypot(x[None, :], y[:, None]), 1) / HAZE_LENGTH)
        veil = np.arange(256)[:, None] / 255 * HORIZON
        self._veil = np.uint8(np.round(np.column_stack([veil, np.zeros(256)])))
        shape = (camera_info.height, camera_info.width)
        self._opaque = np.full(shape, 255, np.uint8)
        self._sky = np.zeros((*shape, 4), np.uint8)

    def apply(self, X_WC, depth, out) -> None:
        """Changes a picture in place.

        Args:
            X_WC: pose of the camera; z forward, x right, y down.
            depth: z of everything in C (m), (h, w), float32; infinite where
                there is nothing.
            out: RGBA, (h, w, 4), uint8.
        """
        clear = cv2.exp(cv2.multiply(depth, self._rate))
        clear = cv2.convertScaleAbs(clear, alpha=255 * HAZE_MOST, beta=255 * (1 - HAZE_MOST))
        share = cv2.merge([clear, clear, clear, self._opaque])
        cv2.multiply(out, share, dst=out, scale=1 / 255)
        veil = cv2.bitwise_not(clear)
        veil = cv2.merge([cv2.LUT(veil, table) for table in self._veil.T.copy()])
        cv2.add(out, veil, dst=out)
        self._background.paint(X_WC, self._sky)
        cv2.copyTo(self._sky, cv2.inRange(depth, np.inf, np.inf), out)
