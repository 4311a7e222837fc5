"""The image sensor: exposure, vignetting and noise."""

import functools

import numpy as np

from airrace.common.jit import compilable, compiled
from airrace.math.random import make_generator
from airrace.rendering.imaging.pixels import LUMA, deep, whole

_LUMA = np.float32(LUMA)
_MARGIN = 256  # of the sheet of noise beyond a picture (px)
_BLOCK = 1024  # pictures whose places in it are drawn together
_STEPS = 25.0  # of noise, a standard deviation; beyond 127 of them it is cut off
_ZERO, _HALF, _ONE, _WHITEST = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(255.0)


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
        self._changes = gain != 1 or vignetting != 0
        self._noisy = read_noise > 0 or shot_noise > 0
        K, w, h = camera_info.K, camera_info.width, camera_info.height
        # Squared tangents of the angle off axis, along a row and down a column.
        self._off_axis = (
            np.float32(((np.arange(w) - K[0, 2]) / K[0, 0]) ** 2),
            np.float32(((np.arange(h) - K[1, 2]) / K[1, 1]) ** 2),
        )
        most = 1 - (1 + sum(tan2.max() for tan2 in self._off_axis)) ** -2.0
        self._light = gain, vignetting / most
        self._variance = read_noise**2, shot_noise
        self._sheet = np.zeros((0, 0), np.int8)
        if not self._noisy:
            return

        @functools.lru_cache(maxsize=2)
        def places(block):
            rng = make_generator(seed, "camera_noise_place", block)
            return rng.integers([_MARGIN + 1, _MARGIN + 1, 2], size=(_BLOCK, 3)).tolist()

        self._places = places  # in the sheet, and whether it is turned over
        rng = make_generator(seed, "camera_noise_sheet")
        sheet = rng.standard_normal((h + _MARGIN, w + _MARGIN), np.float32)
        # Bytes, because most of the time is spent on fetching them.
        self._sheet = np.clip(np.round(_STEPS * sheet), -127, 127).astype(np.int8)

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
            y, x, turned = 0, 0, 0
            if self._noisy:
                y, x, turned = self._places(frame // _BLOCK)[frame % _BLOCK]
            _expose(
                deep(image),
                boxes,
                *self._light,
                *self._off_axis,
                *self._variance,
                self._sheet,
                y,
                x,
                (1.0 - 2.0 * turned) / _STEPS,
            )


@compiled
def _expose(image, boxes, gain, vignetting, across, down, read, shot, sheet, y, x, step):
    """Does to boxes of a picture, (h, w, channels), what Sensor says.

    Args:
        gain: on the brightness.
        vignetting: what is lost of it, per 1 - cos^4 of the angle off axis.
        across, down: its squared tangents, along a row, (w,), and a column, (h,).
        read, shot: variance of the noise in the dark, and for each grey level.
        sheet: of normal numbers; empty for no noise.
        y, x: the place in the sheet that is the picture's first pixel.
        step: what 1 is there, in standard deviations, with a sign.
    """
    channels = image.shape[2]
    gain, vignetting, step = np.float32(gain), np.float32(vignetting), np.float32(step)
    read, shot = np.float32(read), np.float32(shot)
    silence = np.zeros(image.shape[1], np.int8)
    for x0, y0, x1, y1 in boxes:
        aside = across[x0:x1]
        factors, noise = np.empty(len(aside), np.float32), np.empty(len(aside), np.float32)
        for row in range(y0, y1):
            samples = sheet[y + row, x + x0 : x + x1] if len(sheet) > 0 else silence[x0:x1]
            for k in range(len(aside)):
                cos2 = _ONE / (_ONE + aside[k] + down[row])
                factors[k] = gain * (_ONE - vignetting * (_ONE - cos2 * cos2))
            if channels == 1:
                only = image.reshape(len(image), -1)[row, x0:x1]
                for k in range(len(aside)):
                    level = factors[k] * np.float32(only[k])
                    only[k] = _grey_level(
                        level + step * np.float32(samples[k]) * _sigma(level, read, shot)
                    )
                continue
            pixels = image[row, x0:x1]
            for k in range(len(aside)):
                level = _LUMA[0] * np.float32(pixels[k, 0])
                for c in range(1, 3):
                    level += _LUMA[c] * np.float32(pixels[k, c])
                noise[k] = step * np.float32(samples[k]) * _sigma(factors[k] * level, read, shot)
            for k in range(len(aside)):
                for c in range(3):
                    pixels[k, c] = _grey_level(factors[k] * np.float32(pixels[k, c]) + noise[k])


@compilable
def _sigma(level, read, shot):
    """Returns the standard deviation of the noise at a brightness."""
    return np.sqrt(read + shot * min(level, _WHITEST))


@compilable
def _grey_level(level):
    """Returns it as a pixel has it."""
    return np.uint8(np.int32(min(max(level + _HALF, _ZERO), _WHITEST)))
