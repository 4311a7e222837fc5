"""Sky and ground of the planar renderer.

The background is soft, so it is drawn at a quarter of the size and enlarged. A ray through a
pixel meets the sky, or the ground, which is a textured plane behind haze.
"""

import typing
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from airrace.common.jit import compiled
from airrace.rendering.images import Box, colors_for, to_grey
from airrace.rendering.scene.textures import GRASS, HORIZON, grass_detail, haze, sky_color

if TYPE_CHECKING:
    from airrace.vehicle.camera_info import CameraInfo

_SHRINK = 4
_HALF = 1024  # entries of the look-up tables on either side of the horizon
_LOWEST = 0.05  # m, of the camera, as the background is drawn
# Layers of the ground's texture: side of a tile on the ground (m), and grey levels from bright
# to dark.
_TILES, _STRENGTHS = np.array([30.0, 330.0]), np.array([70.0, 60.0])
_TEXELS = _TILES / len(grass_detail())  # m
_DENSITY = 1.0 / _TEXELS  # texels a metre
# Colours of grass and horizon, and how much darker the texture makes them: less so in the
# blue, which grass has little of. By channels of the picture.
_GROUND = {
    channels: np.vstack([colors_for(channels, [GRASS, HORIZON]), tint])
    for channels, tint in ((1, [[to_grey([1.0, 1.0, 0.5])]]), (4, [[1.0, 1.0, 0.5, 0.0]]))
}


class Tables(typing.NamedTuple):
    """What a ray shows, by the sine of its angle below the horizon."""

    colors: np.ndarray  #: of the sky, then of the ground, (2 _HALF, channels)
    #: How much darker the texture makes each channel per grey level, (2 _HALF, layers, channels).
    darkening: np.ndarray


class Rays(typing.NamedTuple):
    """The rays of a small picture."""

    p_WC: np.ndarray  #: where they begin, (3,) m
    R_Wuv: np.ndarray  #: takes (u, v, 1) to their directions in the world, (3, 3)
    shortening: np.ndarray  #: 1 / lengths of these, (h, w)


class Background:
    """Everything that lies behind pylons and boards, for a camera."""

    def __init__(self, camera_info: "CameraInfo"):
        self._w, self._h = -(-camera_info.width // _SHRINK), -(-camera_info.height // _SHRINK)
        # Small pixel i covers the pixels from 4i to 4i + 3; their mean is its centre.
        centre = (_SHRINK - 1) / 2
        S = np.array([[_SHRINK, 0, centre], [0, _SHRINK, centre], [0, 0, 1]])
        self._K_inverse = np.linalg.inv(camera_info.K) @ S  # of the small picture
        u, v = np.meshgrid(np.arange(self._w), np.arange(self._h))
        rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ self._K_inverse.T
        self._shortening = 1.0 / np.linalg.norm(rays, axis=2)
        # Of the grass, with a row and a column more for interpolation.
        self._texture = np.pad(grass_detail(), (0, 1), mode="wrap")
        self._focal = 1 / self._K_inverse[1, 1]
        sky = sky_color((np.arange(_HALF)[::-1] + 0.5) / _HALF)
        self._sky = {channels: colors_for(channels, sky) for channels in _GROUND}

    def paint(self, out: np.ndarray, boxes: ArrayLike, poses: list) -> None:
        """Fills boxes, (n, 4), of a picture, (h, w, channels), with the mean of backgrounds.

        Args: poses: pairs of a weight and the camera's pose X_WC; the weights add up to 1.
        """
        rays = [
            Rays(X.translation(), X.rotation().matrix() @ self._K_inverse, self._shortening)
            for _, X in poses
        ]
        channels = out.shape[2]
        tables = [
            _tables(max(each.p_WC[2], _LOWEST), self._focal, self._sky[channels], _GROUND[channels])
            for each in rays
        ]
        for box in (Box(*box) for box in np.asarray(boxes).tolist()):
            # What it shows of the small picture, and a pixel more for interpolation.
            small = Box(
                max(box.x0 // _SHRINK - 1, 0),
                max(box.y0 // _SHRINK - 1, 0),
                min((box.x1 - 1) // _SHRINK + 2, self._w),
                min((box.y1 - 1) // _SHRINK + 2, self._h),
            )
            pictures = [_draw(small, *each, self._texture) for each in zip(rays, tables)]
            mean = pictures[0]
            if len(poses) > 1:
                weights = [np.float32(weight) for weight, _ in poses]
                mean = np.uint8(sum(w * picture for w, picture in zip(weights, pictures)) + 0.5)
            _enlarge(mean, small, out, box)


@compiled
def _tables(height, focal, sky, ground):
    """Returns the Tables of a camera.

    Args:
        height: of the camera (m). focal: of the small picture (px).
        sky: its half of the colours. ground: see _GROUND.
    """
    channels = sky.shape[1]
    grass, horizon, tint = ground
    tables = Tables(np.empty((2 * _HALF, channels)), np.zeros((2 * _HALF, len(_TEXELS), channels)))
    tables.colors[:_HALF] = sky
    for i in range(_HALF):
        sine = (i + 0.5) / _HALF
        clear = 1.0 - haze(height / sine)
        # A layer is shown as long as its texels are no smaller than a pixel's
        # footprint, which is longest along the line of sight.
        footprint = height / sine**2 / focal
        for c in range(len(grass)):
            level = clear * grass[c] + (1.0 - clear) * horizon[c]
            for k in range(len(_TEXELS)):
                contrast = clear * _STRENGTHS[k] / (1.0 + (footprint / _TEXELS[k] / 2) ** 2)
                # The texture only darkens: its mean is added to the colour.
                level += contrast * tint[c] / 2
                if contrast >= 0.5:  # a grey level is the least that shows
                    tables.darkening[_HALF + i, k, c] = contrast * tint[c] / 255
            tables.colors[_HALF + i, c] = min(level, 255.0)
    return tables


@compiled
def _draw(box, rays, tables, texture):
    """Returns a box of the small picture, (h, w, channels)."""
    x, y, height = rays.p_WC[0], rays.p_WC[1], max(rays.p_WC[2], _LOWEST)
    X, Y, Z = rays.R_Wuv
    channels = tables.colors.shape[1]
    out = np.empty((box.y1 - box.y0, box.x1 - box.x0, channels), np.uint8)
    for v in range(box.y0, box.y1):
        for u in range(box.x0, box.x1):
            down = -(Z[0] * u + (Z[1] * v + Z[2]))
            entry = int((_HALF - 1) * down * rays.shortening[v, u] + _HALF)
            pixel = out[v - box.y0, u - box.x0]
            if down <= 0.0:
                for c in range(channels):
                    pixel[c] = np.uint8(tables.colors[entry, c] + 0.5)
                continue
            along = height / max(down, 1e-9)
            x_W = x + along * (X[0] * u + (X[1] * v + X[2]))
            y_W = y + along * (Y[0] * u + (Y[1] * v + Y[2]))
            near = _interpolate(texture, x_W * _DENSITY[0], y_W * _DENSITY[0])
            far = _interpolate(texture, x_W * _DENSITY[1], y_W * _DENSITY[1])
            for c in range(channels):
                level = tables.colors[entry, c] + 0.5
                level -= near * tables.darkening[entry, 0, c]
                level -= far * tables.darkening[entry, 1, c]
                pixel[c] = np.uint8(np.int32(max(level, 0.0)))
    return out


@compiled
def _interpolate(texture, p, q):
    """Returns the texture of grass at (p, q) texels, between them bilinearly."""
    a, b = np.floor(p), np.floor(q)
    right, below = p - a, q - b
    size = len(texture) - 1
    i, j = int(b) & (size - 1), int(a) & (size - 1)
    here, aside = float(texture[i, j]), float(texture[i, j + 1])
    under, across = float(texture[i + 1, j]), float(texture[i + 1, j + 1])
    top, bottom = here + right * (aside - here), under + right * (across - under)
    return top + below * (bottom - top)


@compiled
def _enlarge(picture, small, out, box):
    """Draws a part of the small picture, the box ``small``, into a box of the large one, ``out``.

    It interpolates bilinearly to twice the small size, and doubles pixels.
    """
    h, w, channels = picture.shape
    n, source, target = w * channels, picture.reshape(h, -1), out.reshape(len(out), -1)
    padded = np.empty(n + 2 * channels, np.uint16)  # with the first and the last column twice
    before, here, after = padded[:n], padded[channels:-channels], padded[2 * channels :]
    left, right = np.empty(n, np.uint8), np.empty(n, np.uint8)  # halves of small pixels
    enlarged = np.empty((w, _SHRINK, channels), np.uint8)
    first, last = box.x0 * channels, box.x1 * channels
    origin = _SHRINK * small.x0 * channels
    for y in range(box.y0, box.y1):
        if y == box.y0 or y % 2 == 0:
            # Of two pixels, the nearer one has three quarters of the weight.
            row, lower = y // _SHRINK - small.y0, y // 2 % 2
            near, far = source[row], source[min(max(row + 2 * lower - 1, 0), h - 1)]
            for k in range(n):
                here[k] = np.uint16(3) * np.uint16(near[k]) + np.uint16(far[k])
            for c in range(channels):
                before[c], after[n - channels + c] = here[c], here[n - channels + c]
            for k in range(n):
                level = np.uint16(3) * here[k] + np.uint16(8)
                left[k] = np.uint8((level + before[k]) >> 4)
                right[k] = np.uint8((level + after[k]) >> 4)
            for c in range(channels):
                for j in range(w):
                    enlarged[j, 0, c] = enlarged[j, 1, c] = left[j * channels + c]
                    enlarged[j, 2, c] = enlarged[j, 3, c] = right[j * channels + c]
        row_in, row_out = (
            enlarged.reshape(-1)[first - origin : last - origin],
            target[y, first:last],
        )
        for k in range(len(row_out)):  # Numba is slow at copying slices
            row_out[k] = row_in[k]
