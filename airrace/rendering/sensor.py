"""The image sensor: exposure, vignetting and noise."""

import functools

import numpy as np

from airrace.compiled import compiled
from airrace.random import make_generator
from airrace.rendering.pixels import LUMA, deep, whole

_LUMA = np.float32(LUMA)
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
        self._brightness = np.float32(gain * (1 - vignetting * _loss(camera_info)))
        self._changes = gain != 1 or vignetting != 0
        self._noisy = read_noise > 0 or shot_noise > 0
        shape = camera_info.height + _MARGIN, camera_info.width + _MARGIN
        # Of a standard deviation for each sample of noise, by brightness.
        self._sigma = np.float32(np.sqrt(read_noise**2 + shot_noise * np.arange(256)))
        self._sheet = np.zeros((0, 0), np.float32)
        if not self._noisy:
            return

        @functools.lru_cache(maxsize=2)
        def place(frame):
            rng = make_generator(seed, "camera_noise_place", frame)
            y, x, turned = rng.integers([_MARGIN + 1, _MARGIN + 1, 2]).tolist()
            return y, x, 1.0 - 2.0 * turned

        self._place = place  # in the sheet, and whether it is turned over
        rng = make_generator(seed, "camera_noise_sheet")
        self._sheet = np.clip(rng.standard_normal(shape, np.float32), -_MOST, _MOST)

    def expose(self, image, frame: int, boxes=None) -> None:
        """Changes a picture in place; opaque pixels stay opaque.

        Args:
            image: RGBA or grey levels, see pixels.py.
            frame: number of the picture >= 0; the noise is a function of it and
                of the place.
            boxes: the parts of it that are changed, (n, 4); None: all of it.
        """
        if self._changes or self._noisy:
            boxes = np.array([whole(image)] if boxes is None else boxes, np.int64).reshape(-1, 4)
            place = self._place(frame) if self._noisy else (0, 0, 0.0)
            _expose(deep(image), boxes, self._brightness, self._sigma, self._sheet, *place)


@compiled
def _expose(image, boxes, brightness, sigma, sheet, y, x, sign):
    """Does to boxes of a picture, (h, w, channels), what Sensor says.

    Args:
        brightness: factor on each pixel, (h, w).
        sigma: of the noise, by brightness, (256,).
        sheet: of standard normal numbers; empty for no noise.
        y, x: the place in the sheet that is the picture's first pixel.
        sign: on the noise.
    """
    channels, half = image.shape[2], np.float32(0.5)
    noisy, sign = len(sheet) > 0, np.float32(sign)
    zero, most = np.float32(0.0), np.float32(255.0)
    flat = image.reshape(len(image), -1)
    for x0, y0, x1, y1 in boxes:
        width = x1 - x0
        grey, noise = np.empty(width, np.float32), np.zeros(width, np.float32)
        for row in range(y0, y1):
            pixels, factors = image[row, x0:x1], brightness[row, x0:x1]
            if noisy:
                if channels == 1:
                    only = flat[row, x0:x1]
                    for k in range(width):
                        grey[k] = min(factors[k] * np.float32(only[k]), most)
                else:
                    for k in range(width):
                        level = np.float32(0.0)
                        for c in range(3):
                            level += _LUMA[c] * np.float32(pixels[k, c])
                        grey[k] = min(factors[k] * level, most)
                samples = sheet[y + row, x + x0:x + x1]
                for k in range(width):
                    noise[k] = sign * sigma[np.int64(grey[k] + half)] * samples[k]
            if channels == 1:
                only = flat[row, x0:x1]
                for k in range(width):
                    level = factors[k] * np.float32(only[k]) + noise[k] + half
                    only[k] = np.uint8(np.int32(min(max(level, zero), most)))
            else:
                for k in range(width):
                    for c in range(3):
                        level = factors[k] * np.float32(pixels[k, c]) + noise[k] + half
                        pixels[k, c] = np.uint8(np.int32(min(max(level, zero), most)))


def _loss(camera_info):
    """Returns 1 - cos^4 of the angle off axis, as a share of its greatest, (h, w)."""
    K = camera_info.K
    x = (np.arange(camera_info.width) - K[0, 2]) / K[0, 0]
    y = (np.arange(camera_info.height) - K[1, 2]) / K[1, 1]
    loss = 1 - (1 + x[None, :] ** 2 + y[:, None] ** 2) ** -2.0
    return loss / loss.max()
