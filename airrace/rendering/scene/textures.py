"""Pictures and colours of the scene, made at run time and shared by renderers.

Colours are RGB triples from 0 to 255.
"""

import functools

import cv2
import numpy as np
from numpy.typing import ArrayLike

from airrace.common.jit import compilable

WHITE = 245.0  # of a board; a little short of 255 to leave room for noise
BLACK = 15.0
BOARD_BACK = (58.0, 60.0, 64.0)
PYLON_COLOR = (242.0, 98.0, 26.0)
STRIPE_COLOR = (240.0, 236.0, 228.0)
GRASS = (104.0, 142.0, 62.0)
EARTH = (70.0, 56.0, 40.0)  # what a camera below the ground sees
HORIZON = (206.0, 222.0, 236.0)
ZENITH = (66.0, 124.0, 202.0)

# Unit vector to the sun and the share of light that comes from all around.
SUN_W = np.array([-0.45, -0.55, 0.70]) / np.linalg.norm([-0.45, -0.55, 0.70])
AMBIENT = 0.55

# Of haze(): its most, and the distance over which it approaches that (m).
HAZE_MOST = 0.85
HAZE_LENGTH = 350.0


def marker_modules(marker_id: int) -> np.ndarray:
    """Returns the modules of a marker of DICT_ARUCO_ORIGINAL, True where white, (7, 7)."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_ARUCO_ORIGINAL)
    return cv2.aruco.generateImageMarker(dictionary, marker_id, 7) > 0


@functools.cache
def grass_detail(size: int = 512) -> np.ndarray:
    """Returns how much darker than GRASS the ground is, for one tile, (size, size), uint8.

    It goes from 0 (bright) to 255 (dark), and continues seamlessly over its borders.
    """
    rng = np.random.default_rng(1)
    # Pink noise: white noise shaped in the Fourier domain is periodic.
    f = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None, :])
    f[0, 0] = np.inf
    spectrum = np.fft.rfft2(rng.standard_normal((size, size))) / f**0.75
    noise = np.fft.irfft2(spectrum, s=(size, size))
    image = np.clip(128 + 52 * noise / noise.std(), 0, 255).astype(np.uint8)
    image.setflags(write=False)
    return image


def sky_color(sin_elevation: np.ndarray) -> np.ndarray:
    """Returns the colour of the sky, (n, 3), by the sine of the angle above the horizon, (n,)."""
    up = np.clip(sin_elevation, 0.0, 1.0)[:, None] ** 0.6
    return (1 - up) * np.array(HORIZON) + up * np.array(ZENITH)


@compilable
def haze(distance: float | np.ndarray) -> float | np.ndarray:
    """Returns the share of the horizon's colour that lies over a thing at a distance (m)."""
    return HAZE_MOST * (1.0 - np.exp(-distance / HAZE_LENGTH))


def shade(color: ArrayLike, normals_W: np.ndarray) -> np.ndarray:
    """Returns the colours, (n, 3), of a matt surface with unit normals, (n, 3), in the sunlight."""
    light = AMBIENT + (1 - AMBIENT) * np.clip(normals_W @ SUN_W, 0.0, 1.0)
    return np.asarray(color) * light[:, None]
