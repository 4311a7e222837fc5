"""Sky and ground of the planar renderer."""

import math

import numpy as np

from airrace.compiled import compiled
from airrace.rendering.pixels import colors_for, deep, to_grey, whole
from airrace.rendering.textures import (
    GRASS,
    HAZE_LENGTH,
    HAZE_MOST,
    HORIZON,
    grass_detail,
    sky_color,
)

_SHRINK = 4  # the background is soft: it is drawn at a quarter of the size
_TILE_W, _TILE_H = 16, 12  # of the small picture, which are drawn together
_HALF = 1024  # entries of the look-up tables on either side of the horizon


class _GrassLayer:
    """One scale of the ground's texture."""

    def __init__(self, *, tile, strength):
        self.tile = tile  # side of the texture on the ground (m)
        self.strength = strength  # grey levels from bright to dark
        self.texel = tile / len(grass_detail())


_LAYERS = (_GrassLayer(tile=30.0, strength=70.0), _GrassLayer(tile=330.0, strength=60.0))
_TEXELS, _STRENGTHS = np.array([(layer.texel, layer.strength) for layer in _LAYERS]).T.copy()
# Colours of grass and horizon, and how much darker the texture makes them: less so in the
# blue, which grass has little of. By channels of the picture.
_GROUND = {
    channels: np.vstack([colors_for(channels, [GRASS, HORIZON]), tint])
    for channels, tint in ((1, [[to_grey([1.0, 1.0, 0.5])]]), (4, [[1.0, 1.0, 0.5, 0.0]]))
}


class Background:
    """Everything that lies behind pylons and boards, for a camera."""

    def __init__(self, camera_info):
        self.width, self.height = camera_info.width, camera_info.height
        self.w, self.h = -(-self.width // _SHRINK), -(-self.height // _SHRINK)
        # Small pixel i covers the pixels from 4i to 4i + 3; their mean is its
        # centre. Scaled by the true ratio, should the size not divide by 4.
        sx, sy = self.width / self.w, self.height / self.h
        S = np.array([[sx, 0, (sx - 1) / 2], [0, sy, (sy - 1) / 2], [0, 0, 1]])
        self.K_inverse = np.linalg.inv(camera_info.K) @ S  # of the small picture
        u, v = np.meshgrid(np.arange(self.w), np.arange(self.h))
        rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ self.K_inverse.T
        self.shortening = 1.0 / np.linalg.norm(rays, axis=2)
        self._focal = 1 / self.K_inverse[1, 1]
        sky = sky_color((np.arange(_HALF)[::-1] + 0.5) / _HALF)
        self._sky = {channels: colors_for(channels, sky) for channels in _GROUND}

    def paint(self, X_WC, out) -> None:
        """Fills a picture.

        Args:
            X_WC: pose of the camera; z forward, x right, y down.
            out: RGBA or grey levels, see pixels.py.
        """
        Backdrop(self, X_WC).paint(deep(out), np.array([whole(out)]))

    def tables(self, height, channels):
        """Returns colours and contrasts over the sine of the depression angle.

        Args:
            height: of the camera (m).
            channels: of the picture.

        Returns:
            colours, sky, then ground, (2 _HALF, channels); and how much darker the layers
            of grass make each channel at most, (2 _HALF, layers, channels).
        """
        tables = np.zeros((2 * _HALF, channels)), np.zeros((2 * _HALF, len(_LAYERS), channels))
        tables[0][:_HALF] = self._sky[channels]
        _fill_tables(*tables, height, self._focal, *_GROUND[channels], _TEXELS, _STRENGTHS)
        return tables


@compiled
def _fill_tables(colors, darkening, height, focal, grass, horizon, tint, texels, strengths):
    """Fills the ground's half of the tables; see Background.tables().

    Args:
        focal: of the small picture (px).
        grass, horizon, tint: colours, and how much the layers show in them, (channels,).
        texels, strengths: of the layers, (n,) m and grey levels.
    """
    for i in range(_HALF):
        sine = (i + 0.5) / _HALF
        clear = 1.0 - HAZE_MOST * (1.0 - math.exp(-height / sine / HAZE_LENGTH))
        # A texture is shown as long as its texels are no smaller than a pixel's
        # footprint, which is longest along the line of sight.
        footprint = height / sine**2 / focal
        for c in range(len(grass)):
            level = clear * grass[c] + (1.0 - clear) * horizon[c]
            for k in range(len(texels)):
                contrast = clear * strengths[k] / (1.0 + (footprint / texels[k] / 2) ** 2)
                # The texture only darkens: its mean is added to the colour.
                level += contrast * tint[c] / 2
                if contrast >= 0.5:  # a grey level is the least that shows
                    darkening[_HALF + i, k, c] = contrast * tint[c] / 255
            colors[_HALF + i, c] = min(level, 255.0)


class Backdrop:
    """The background of one picture, to be painted piece by piece."""

    def __init__(self, background: Background, X_WC):
        """Args: background: of all pictures. X_WC: pose of the camera."""
        self._background = background
        self._p_WC = X_WC.translation()
        self._ray_W = X_WC.rotation().matrix() @ background.K_inverse
        self._drawn = {}  # by the number of channels

    def paint(self, out, boxes) -> None:
        """Fills boxes, (n, 4), of a picture, (h, w, channels)."""
        background, channels = self._background, out.shape[2]
        height = max(self._p_WC[2], 0.05)
        if channels not in self._drawn:
            w, h = background.w, background.h
            self._drawn[channels] = (
                np.empty((h, w, channels), np.uint8),
                np.zeros((-(-h // _TILE_H), -(-w // _TILE_W)), np.bool_),
                *background.tables(height, channels),
            )
        small, done, colors, darkening = self._drawn[channels]
        _draw_small(small, done, boxes, out.shape[1], out.shape[0], self._ray_W,
                    background.shortening, self._p_WC[0], self._p_WC[1], height, colors,
                    darkening, grass_detail(), _TEXELS)
        for box in boxes:
            _enlarge(small, out, box)


@compiled
def _draw_small(small, done, boxes, width, height, ray_W, shortening, x, y, above, colors,
                darkening, grass, texels):
    """Draws those tiles of the small picture that boxes of the large one need.

    Args:
        small: (h, w, channels). done: which of its tiles are drawn.
        boxes: (n, 4). width, height: of the large picture.
        ray_W: maps (u, v, 1) to the ray's direction in the world, (3, 3).
        shortening: 1 / length of the rays, (h, w).
        x, y, above: where the camera is (m).
        colors, darkening: see Background.tables().
        grass: texture, (n, n), n a power of two. texels: their sizes (m), by layer.
    """
    h, w, _ = small.shape
    levels = np.empty(len(texels))
    for x0, y0, x1, y1 in boxes:
        # One pixel more is needed to either side, to interpolate.
        i0, i1 = max(y0 * h // height - 1, 0), min((y1 - 1) * h // height + 1, h - 1)
        j0, j1 = max(x0 * w // width - 1, 0), min((x1 - 1) * w // width + 1, w - 1)
        for i in range(i0 // _TILE_H, i1 // _TILE_H + 1):
            for j in range(j0 // _TILE_W, j1 // _TILE_W + 1):
                if not done[i, j]:
                    done[i, j] = True
                    for v in range(i * _TILE_H, min((i + 1) * _TILE_H, h)):
                        for u in range(j * _TILE_W, min((j + 1) * _TILE_W, w)):
                            down = -(ray_W[2, 0] * u + ray_W[2, 1] * v + ray_W[2, 2])
                            entry = int((_HALF - 1) * down * shortening[v, u] + _HALF)
                            # The ground point is p_WC + ray * height / (down of the ray).
                            along = above / max(down, 1e-9)
                            _read_grass(
                                levels, darkening[entry],
                                x + along * (ray_W[0, 0] * u + ray_W[0, 1] * v + ray_W[0, 2]),
                                y + along * (ray_W[1, 0] * u + ray_W[1, 1] * v + ray_W[1, 2]),
                                grass, texels)
                            for c in range(small.shape[2]):
                                level = colors[entry, c] + 0.5
                                for k in range(len(texels)):
                                    level -= levels[k] * darkening[entry, k, c]
                                small[v, u, c] = np.uint8(np.int32(max(level, 0.0)))


@compiled
def _read_grass(levels, darkening, x, y, grass, texels):
    """Reads the layers of the grass's texture at a point of the ground.

    Args:
        levels: where to put them, (layers,); zero of those that darken nothing.
        darkening: of the layers, (layers, channels).
        x, y: the point (m). grass, texels: see _draw_small().
    """
    last = len(grass) - 1
    for k in range(len(texels)):
        levels[k] = 0.0
        if darkening[k, 0] > 0.0:
            tx, ty = x / texels[k], y / texels[k]
            a, b = int(math.floor(tx)), int(math.floor(ty))
            fx, fy = tx - a, ty - b
            a0, b0, a1, b1 = a & last, b & last, (a + 1) & last, (b + 1) & last
            top = grass[b0, a0] + fx * (float(grass[b0, a1]) - grass[b0, a0])
            bottom = grass[b1, a0] + fx * (float(grass[b1, a1]) - grass[b1, a0])
            levels[k] = top + fy * (bottom - top)


@compiled
def _enlarge(small, out, box):
    """Draws a box of the large picture: interpolates to half its size, and doubles pixels."""
    h, w, channels = small.shape
    height, width = out.shape[:2]
    x0, y0, x1, y1 = box
    quick = channels == 1 and width == 4 * w and x0 % 4 == 0 and x1 % 4 == 0
    j0, j1 = x0 * w // width, (x1 - 1) * w // width + 1
    flat, source = out.reshape(height, -1), small.reshape(h, -1)
    # What is interpolated between rows, of columns j0 - 1 to j1.
    blend = np.empty((j1 - j0 + 2) * channels, np.uint16)
    wide = np.empty(2 * (j1 - j0), np.uint16)
    before = -1
    for y in range(y0, y1):
        half = y * 2 * h // height
        row = flat[y, x0 * channels:x1 * channels]
        if half == before:
            row[:] = flat[y - 1, x0 * channels:x1 * channels]
            continue
        before = half
        near = half // 2
        far = min(max(near + (1 if half % 2 else -1), 0), h - 1)
        a = source[near, j0 * channels:j1 * channels]
        b = source[far, j0 * channels:j1 * channels]
        middle = blend[channels:-channels]
        for k in range(len(a)):
            middle[k] = np.uint16(3) * np.uint16(a[k]) + np.uint16(b[k])
        for j, k in ((max(j0 - 1, 0), 0), (min(j1, w - 1), j1 - j0 + 1)):
            for c in range(channels):
                blend[k * channels + c] = np.uint16(
                    3 * int(small[near, j, c]) + int(small[far, j, c]))
        if quick:
            left, right = blend[:-2], blend[2:]
            for k in range(len(a)):
                centre = np.uint16(3) * middle[k] + np.uint16(8)
                wide[2 * k] = ((centre + left[k]) >> 4) * np.uint16(257)
                wide[2 * k + 1] = ((centre + right[k]) >> 4) * np.uint16(257)
            row.view(np.uint16)[:] = wide
            continue
        for x in range(x0, x1):
            half_x = x * 2 * w // width
            k = half_x // 2 - j0 + 1
            aside = k + (1 if half_x % 2 else -1)
            for c in range(channels):
                level = 3 * int(blend[k * channels + c]) + int(blend[aside * channels + c])
                row[(x - x0) * channels + c] = np.uint8((level + 8) >> 4)
