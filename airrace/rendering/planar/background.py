"""Sky and ground of the planar renderer."""

import numpy as np

from airrace.common.jit import compiled
from airrace.rendering.imaging.pixels import colors_for, deep, to_grey, whole
from airrace.rendering.planar.background_tiles import HALF, TILE_H, TILE_W, draw_tiles
from airrace.rendering.planar.enlarging import enlarge
from airrace.rendering.scene.textures import (
    GRASS,
    HORIZON,
    grass_detail,
    grass_squares,
    haze,
    sky_color,
)

_SHRINK = 4  # the background is soft: it is drawn at a quarter of the size


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
        sky = sky_color((np.arange(HALF)[::-1] + 0.5) / HALF)
        self._sky = {channels: colors_for(channels, sky) for channels in _GROUND}

    def paint(self, X_WC, out, box=None) -> None:
        """Fills a picture, or a box of it.

        Args:
            X_WC: pose of the camera; z forward, x right, y down.
            out: RGBA or grey levels, see pixels.py.
            box: see there; None for all of it.
        """
        Backdrop(self, [(1.0, X_WC)]).paint(deep(out), np.array([box or whole(out)]))

    def tables(self, height, channels):
        """Returns colours and contrasts over the sine of the depression angle.

        Args:
            height: of the camera (m).
            channels: of the picture.

        Returns:
            colours, sky, then ground, (2 HALF, channels); and how much darker the layers
            of grass make each channel at most, (2 HALF, layers, channels).
        """
        tables = np.zeros((2 * HALF, channels)), np.zeros((2 * HALF, len(_LAYERS), channels))
        tables[0][:HALF] = self._sky[channels]
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
    for i in range(HALF):
        sine = (i + 0.5) / HALF
        clear = 1.0 - haze(height / sine)
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
                    darkening[HALF + i, k, c] = contrast * tint[c] / 255
            colors[HALF + i, c] = min(level, 255.0)


class Backdrop:
    """The background of one picture, or the mean of several, to be painted piece by piece."""

    def __init__(self, background: Background, poses):
        """Args: background: of all pictures. poses: pairs of a weight and X_WC."""
        self._background, self._poses = background, poses
        self._drawn = {}  # by the number of channels

    def paint(self, out, boxes) -> None:
        """Fills boxes, (n, 4), of a picture, (h, w, channels)."""
        channels = out.shape[2]
        if channels not in self._drawn:
            self._drawn[channels] = [
                (weight, _SmallPicture(self._background, X_WC, channels))
                for weight, X_WC in self._poses
            ]
        pictures = [(weight, small.drawn(out, boxes)) for weight, small in self._drawn[channels]]
        if len(pictures) == 1:
            mean = pictures[0][1]
        else:
            mean = np.uint8(sum(np.float32(weight) * small for weight, small in pictures) + 0.5)
        for box in boxes:
            enlarge(mean, out, box)


class _SmallPicture:
    """The background at a quarter of the size, of which parts are drawn when needed."""

    def __init__(self, background: Background, X_WC, channels):
        self._background = background
        self._p_WC = X_WC.translation()
        self._height = max(self._p_WC[2], 0.05)
        self._ray_W = X_WC.rotation().matrix() @ background.K_inverse
        self._tables = background.tables(self._height, channels)
        w, h = background.w, background.h
        self._pixels = np.zeros((h, w, channels), np.uint8)
        self._done = np.zeros((-(-h // TILE_H), -(-w // TILE_W)), np.bool_)

    def drawn(self, out, boxes):
        """Returns it, (h, w, channels), valid where boxes of the large one need it."""
        draw_tiles(
            self._pixels,
            self._done,
            boxes,
            out.shape[1],
            out.shape[0],
            self._ray_W,
            self._background.shortening,
            self._p_WC[0],
            self._p_WC[1],
            self._height,
            *self._tables,
            grass_squares(),
            _TEXELS,
        )
        return self._pixels
