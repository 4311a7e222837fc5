"""The image sensor: exposure, vignetting and noise."""

import functools

import cv2
import numpy as np

from airrace.random import make_generator
from airrace.rendering.pixels import is_grey, part, whole

_MARGIN = 256  # of the sheet of noise beyond a picture (px)
_STRIP = 120  # rows that are worked on at a time
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
            self._mask = {True: rgb, False: cv2.merge([rgb, rgb, rgb, alpha])}  # is it grey?
        self._noisy = read_noise > 0 or shot_noise > 0
        if not self._noisy:
            return

        @functools.lru_cache(maxsize=2)
        def place(frame):
            rng = make_generator(seed, "camera_noise_place", frame)
            return rng.integers([_MARGIN + 1, _MARGIN + 1, 2]).tolist()

        self._place = place  # in the sheets, and which of the latter two
        shape = (camera_info.height + _MARGIN, camera_info.width + _MARGIN)
        z = make_generator(seed, "camera_noise_sheet").standard_normal(shape, np.float32)
        # OpenCV is fastest on bytes, so there is one sheet of amounts and one that
        # says where they make the picture darker; or, turned over, brighter.
        self._amount = np.uint8(np.round(np.clip(np.abs(z) * (255 / _MOST), 0, 255)))
        darker = np.uint8(255 * (z < 0))
        self._darker = [darker, 255 - darker]
        sigma = np.sqrt(read_noise**2 + shot_noise * np.arange(256))
        self._sigma = np.uint8(np.round(sigma / sigma[-1] * 255))
        self._noise_scale = sigma[-1] / 255 * _MOST / 255

    def expose(self, image, frame: int, box=None) -> None:
        """Changes a picture in place; opaque pixels stay opaque.

        Args:
            image: RGBA or grey levels, see pixels.py.
            frame: number of the picture >= 0; the noise is a function of it and
                of the place.
            box: the part of it that is changed; None: all of it.
        """
        x0, y0, x1, y1 = whole(image) if box is None else box
        mask = None if self._mask is None else self._mask[is_grey(image)]
        if self._noisy:
            y, x, turned = self._place(frame)
            sheets = [sheet[y:, x:] for sheet in (self._amount, self._darker[turned])]
        # Strips stay in the processor's cache from one step to the next.
        for start in range(y0, y1, _STRIP):
            strip = x0, start, x1, min(start + _STRIP, y1)
            pixels = part(image, strip)
            if mask is not None:
                cv2.multiply(pixels, part(mask, strip), dst=pixels, scale=self._scale)
            if self._noisy:
                self._add_noise(pixels, *(part(sheet, strip) for sheet in sheets))

    def _add_noise(self, image, amount, darker):
        """Adds noise to a picture, given the sheets of the same size."""
        grey = image if is_grey(image) else cv2.cvtColor(image, cv2.COLOR_RGBA2GRAY)
        sigma = cv2.LUT(grey, self._sigma)
        noise = cv2.multiply(sigma, amount, scale=self._noise_scale)
        if not is_grey(image):
            nothing = np.zeros_like(noise)
            noise, darker = (cv2.merge([a, a, a, nothing]) for a in (noise, darker))
        # What is added to the negative is subtracted from the picture.
        cv2.bitwise_xor(image, darker, dst=image)
        cv2.add(image, noise, dst=image)
        cv2.bitwise_xor(image, darker, dst=image)


def _loss(camera_info):
    """Returns 1 - cos^4 of the angle off axis, as a share of its greatest, (h, w)."""
    K = camera_info.K
    x = (np.arange(camera_info.width) - K[0, 2]) / K[0, 0]
    y = (np.arange(camera_info.height) - K[1, 2]) / K[1, 1]
    loss = 1 - (1 + x[None, :] ** 2 + y[:, None] ** 2) ** -2.0
    return loss / loss.max()
