"""The image sensor: exposure, vignetting and noise."""

import functools
import typing
from typing import TYPE_CHECKING

import numpy as np

from airrace.common.jit import compilable, compiled
from airrace.math.random import make_generator
from airrace.rendering.images import LUMA, as_boxes, with_channels

if TYPE_CHECKING:
    from airrace.vehicle.camera_info import CameraInfo

_LUMA = np.float32(LUMA)
_MARGIN = 256  # of the sheet of noise beyond a picture (px)
_BLOCK = 1024  # pictures whose places in it are drawn together
_STEPS = 25.0  # of noise, a standard deviation; beyond 127 of them it is cut off
_ZERO, _HALF, _ONE, _WHITEST = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(255.0)


class Light(typing.NamedTuple):
    """How much of the light becomes signal."""

    gain: float  #: on the brightness
    vignetting: float  #: what is lost of it, per 1 - cos^4 of the angle off axis
    #: across, down: squared tangents of this angle, along a row, (w,), and a column, (h,)
    across: np.ndarray
    down: np.ndarray


class Noise(typing.NamedTuple):
    """The noise of one picture, float32."""

    #: read, shot: its variance in the dark, and for each grey level
    read: float
    shot: float
    sheet: np.ndarray  #: normal numbers, int8; empty for no noise
    #: x, y: the place in the sheet that is the picture's first pixel
    x: int
    y: int
    step: float  #: what 1 is there, in standard deviations, with a sign


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

    def __init__(
        self,
        *,
        camera_info: "CameraInfo",
        gain: float,
        vignetting: float,
        read_noise: float,
        shot_noise: float,
        seed: int,
    ):
        """Constructs the sensor.

        Args:
            gain: on the brightness.
            vignetting: share of the light lost in the corners, 0 to 1.
            read_noise: standard deviation in the dark (grey levels).
            shot_noise: variance for each grey level of brightness.
            camera_info, seed: calibration; of the noise, >= 0.
        """
        self._is_ideal = gain == 1 and vignetting == 0 and read_noise == 0 and shot_noise == 0
        K, w, h = camera_info.K, camera_info.width, camera_info.height
        across = np.float32(((np.arange(w) - K[0, 2]) / K[0, 0]) ** 2)
        down = np.float32(((np.arange(h) - K[1, 2]) / K[1, 1]) ** 2)
        most = 1 - (1 + (across.max() + down.max())) ** -2.0
        self._light = Light(np.float32(gain), np.float32(vignetting / most), across, down)  # type: ignore[arg-type]
        read, shot = np.float32(read_noise**2), np.float32(shot_noise)
        self._noise = Noise(read, shot, np.zeros((0, 0), np.int8), 0, 0, _ZERO)  # type: ignore[arg-type]
        self._is_noisy = read_noise > 0 or shot_noise > 0

        @functools.lru_cache(maxsize=2)
        def places(seed, block):
            rng = make_generator(seed, "camera_noise_place", block)
            return rng.integers([_MARGIN + 1, _MARGIN + 1, 2], size=(_BLOCK, 3)).tolist()

        @functools.lru_cache(maxsize=2)
        def sheet(seed):
            rng = make_generator(seed, "camera_noise_sheet")
            normal = rng.standard_normal((h + _MARGIN, w + _MARGIN), np.float32)
            # Bytes, because most of the time is spent on fetching them.
            return np.clip(np.round(_STEPS * normal), -127, 127).astype(np.int8)

        # Places in the sheet, and whether it is turned over; and the sheet itself.
        self._places, self._sheet, self._seed = places, sheet, seed
        if self._is_noisy:
            sheet(seed)

    def expose(
        self,
        image: np.ndarray,
        frame: int,
        boxes: np.ndarray | None = None,
        seed: int | None = None,
    ) -> None:
        """Changes a picture in place; opaque pixels stay opaque.

        Args:
            image: RGBA or grey levels, see images.py.
            frame: number of the picture >= 0; the noise is a function of it and of the place.
            boxes: the parts of it that are changed, (n, 4); None: all of it.
            seed: of the noise, in the place of the sensor's.
        """
        if self._is_ideal:
            return
        noise = self._noise
        if self._is_noisy:
            seed = self._seed if seed is None else seed
            y, x, turned = self._places(seed, frame // _BLOCK)[frame % _BLOCK]
            step = np.float32((1.0 - 2.0 * turned) / _STEPS)
            noise = noise._replace(sheet=self._sheet(seed), x=x, y=y, step=step)  # type: ignore[arg-type]
        _expose(with_channels(image), as_boxes(boxes, image), self._light, noise)


@compiled
def _expose(image, boxes, light, noise):
    """Does to boxes of a picture, (h, w, channels), what Sensor says."""
    channels, step = image.shape[2], noise.step
    silence = np.zeros(image.shape[1], np.int8)
    for x0, y0, x1, y1 in boxes:
        across = light.across[x0:x1]
        factors, added = np.empty(len(across), np.float32), np.empty(len(across), np.float32)
        for row in range(y0, y1):
            samples = silence[x0:x1]
            if len(noise.sheet) > 0:
                samples = noise.sheet[noise.y + row, noise.x + x0 : noise.x + x1]
            for k in range(len(across)):
                cos2 = _ONE / (_ONE + across[k] + light.down[row])
                factors[k] = light.gain * (_ONE - light.vignetting * (_ONE - cos2 * cos2))
            if channels == 1:
                only = image.reshape(len(image), -1)[row, x0:x1]
                for k in range(len(across)):
                    level = factors[k] * np.float32(only[k])
                    only[k] = _grey_level(
                        level + step * np.float32(samples[k]) * _sigma(level, noise)
                    )
                continue
            pixels = image[row, x0:x1]
            for k in range(len(across)):
                level = _LUMA[0] * np.float32(pixels[k, 0])
                for c in range(1, 3):
                    level += _LUMA[c] * np.float32(pixels[k, c])
                added[k] = step * np.float32(samples[k]) * _sigma(factors[k] * level, noise)
            for k in range(len(across)):
                for c in range(3):
                    pixels[k, c] = _grey_level(factors[k] * np.float32(pixels[k, c]) + added[k])


@compilable
def _sigma(level, noise):
    """Returns the standard deviation of the noise at a brightness."""
    return np.sqrt(noise.read + noise.shot * min(level, _WHITEST))


@compilable
def _grey_level(level):
    """Returns it as a pixel has it."""
    return np.uint8(np.int32(min(max(level + _HALF, _ZERO), _WHITEST)))
