"""The image sensor: exposure, vignetting and noise."""

import cv2
import numpy as np

from airrace.random import make_generator

_MARGIN = 256  # of the sheet of noise beyond a picture (px)
_MOST = 5.0  # standard normal numbers beyond that are cut off


class Sensor:
    """Does to a picture what a sensor does to the light, in grey levels.

    A pixel of brightness I becomes ``gain * V * I`` plus normal noise of the
    variance ``read_noise^2 + shot_noise * gain * V * I``, rounded and limited
    to 0 ... 255. (Photon noise is Poisson's, whose variance is its mean.) The
    noise is the same in all three colours, so that it is just that noise
    in grey levels too, which is what a detector looks at.

    ``V`` falls from 1 in the middle to ``1 - vignetting`` in the farthest
    corner, in proportion to what the cos^4 law of thin lenses takes away.
    """

    def __init__(self, *, camera_info, gain, vignetting, read_noise, shot_noise, seed):
        """Constructs the sensor.

        Args:
            camera_info: calibration.
            gain: on the brightness.
            vignetting: share of the light lost in the corners, 0 to 1.
            read_noise: standard deviation in the dark (grey levels).
            shot_noise: variance for each grey level of brightness.
            seed: of the noise, >= 0.
        """
        self._mask = None
        if gain != 1 or vignetting != 0:
            self._scale = max(gain, 1.0) / 255
            mask = gain / self._scale * (1 - vignetting * _loss(camera_info))
            rgb = np.uint8(np.round(mask))
            # Rounded up, so that an opaque pixel stays at 255.
            alpha = np.full_like(rgb, int(np.ceil(1 / self._scale)))
            self._mask = cv2.merge([rgb, rgb, rgb, alpha])
        self._noisy = read_noise > 0 or shot_noise > 0
        if not self._noisy:
            return
        self._seed = seed
        shape = (camera_info.height + _MARGIN, camera_info.width + _MARGIN)
        z = make_generator(seed, "camera_noise_sheet").standard_normal(shape, np.float32)
        # OpenCV is fastest on bytes, so there is one sheet of what is brighter
        # and one of what is darker.
        z *= 255 / _MOST
        self._sheets = [np.uint8(np.round(np.clip(part, 0, 255))) for part in (z, -z)]
        sigma = np.sqrt(read_noise**2 + shot_noise * np.arange(256))
        self._sigma = np.uint8(np.round(sigma / sigma[-1] * 255))
        self._noise_scale = sigma[-1] / 255 * _MOST / 255
        self._zeros = np.zeros((camera_info.height, camera_info.width), np.uint8)

    def expose(self, image, frame: int) -> None:
        """Changes a picture in place; opaque pixels stay opaque.

        Args:
            image: RGBA, (h, w, 4), uint8.
            frame: number of the picture >= 0; the noise is a function of it.
        """
        if self._mask is not None:
            cv2.multiply(image, self._mask, dst=image, scale=self._scale)
        if self._noisy:
            self._add_noise(image, frame)

    def _add_noise(self, image, frame):
        h, w = image.shape[:2]
        rng = make_generator(self._seed, "camera_noise_place", frame)
        y, x, turned = rng.integers([_MARGIN + 1, _MARGIN + 1, 2]).tolist()
        sigma = cv2.LUT(cv2.cvtColor(image, cv2.COLOR_RGBA2GRAY), self._sigma)
        brighter, darker = (
            cv2.multiply(sigma, sheet[y : y + h, x : x + w], scale=self._noise_scale)
            for sheet in (self._sheets[::-1] if turned else self._sheets)
        )
        cv2.add(image, cv2.merge([brighter] * 3 + [self._zeros]), dst=image)
        cv2.subtract(image, cv2.merge([darker] * 3 + [self._zeros]), dst=image)


def _loss(camera_info):
    """Returns 1 - cos^4 of the angle off axis, as a share of its greatest, (h, w)."""
    K = camera_info.K
    x = (np.arange(camera_info.width) - K[0, 2]) / K[0, 0]
    y = (np.arange(camera_info.height) - K[1, 2]) / K[1, 1]
    loss = 1 - (1 + x[None, :] ** 2 + y[:, None] ** 2) ** -2.0
    return loss / loss.max()
