"""Sky and ground of the planar renderer."""

import cv2
import numpy as np

from airrace.rendering.pixels import is_grey, part, to_grey
from airrace.rendering.textures import (
    GRASS,
    HORIZON,
    grass_detail,
    haze,
    sky_color,
)

_SHRINK = 4  # the background is soft: it is drawn at a quarter of the size
_HALF = 1024  # entries of the look-up tables on either side of the horizon


class _GrassLayer:
    """One scale of the ground's texture."""

    def __init__(self, *, tile, strength):
        self.tile = tile  # side of the texture on the ground (m)
        self.strength = strength  # grey levels from bright to dark
        self.texel = tile / len(grass_detail())


_LAYERS = (_GrassLayer(tile=30.0, strength=70.0), _GrassLayer(tile=330.0, strength=60.0))


class Background:
    """Paints everything that lies behind pylons and boards."""

    def __init__(self, camera_info):
        self._width, self._height = camera_info.width, camera_info.height
        self._w = -(-camera_info.width // _SHRINK)
        self._h = -(-camera_info.height // _SHRINK)
        # Small pixel i covers the pixels from 4i to 4i + 3; their mean is its
        # centre. Scaled by the true ratio, should the size not divide by 4.
        sx, sy = self._width / self._w, self._height / self._h
        S = np.array([[sx, 0, (sx - 1) / 2], [0, sy, (sy - 1) / 2], [0, 0, 1]])
        self._K_inverse = np.linalg.inv(camera_info.K) @ S
        u, v = np.meshgrid(np.arange(self._w), np.arange(self._h))
        pixels = np.stack([u, v, np.ones_like(u)], axis=-1)
        rays = pixels @ self._K_inverse.T
        rays /= np.linalg.norm(rays, axis=2)[..., None]
        # Scaled such that a scalar product with "down" is an index.
        self._rays = np.float32((_HALF - 1) * rays.reshape(-1, 3))
        self._focal = 1 / self._K_inverse[1, 1]  # of the small image (px)
        # Tables over the sine of the depression angle: sky, then ground.
        self._sine = (np.arange(_HALF) + 0.5) / _HALF  # of the ground's entries
        self._colors = np.full((2 * _HALF, 4), 255, np.uint8)
        self._colors[:_HALF, :3] = np.round(sky_color(self._sine[::-1]))
        self._contrasts = [np.zeros(2 * _HALF, np.uint8) for _ in _LAYERS]
        self._grass_tiles = np.tile(grass_detail(), (4, 4))

    def paint(self, X_WC, out) -> None:
        """Fills the picture.

        Args:
            X_WC: pose of the camera; z forward, x right, y down.
            out: RGBA or grey levels, see pixels.py.
        """
        Backdrop(self, X_WC).paint(out, (0, 0, self._width, self._height))

    def paint_half(self, X_WC, grey) -> np.ndarray:
        """Returns the picture at half the size, for its pixels to be doubled.

        Args:
            X_WC: see paint().
            grey: whether in grey levels, (h, w), or else RGBA, (h, w, 4).
        """
        R_WC = X_WC.rotation().matrix()
        p_WC = X_WC.translation()
        height = max(p_WC[2], 0.05)
        # Colour and contrast depend on the sine of the depression angle only.
        index = (self._rays @ np.float32(-R_WC[2]) + _HALF).astype(np.intp)
        index = index.reshape(self._h, self._w)
        self._fill_tables(height)
        if grey:
            table = cv2.cvtColor(self._colors[None], cv2.COLOR_RGBA2GRAY)[0]
            small = table.take(index, mode="wrap")
        else:
            small = self._colors.view(np.uint32).take(index, mode="wrap")
            small = small.view(np.uint8).reshape(self._h, self._w, 4)
        ray_W = R_WC @ self._K_inverse  # maps (u, v, 1) to the ray's direction
        rows = self._ground_rows(-ray_W[2])
        if rows.stop > rows.start:
            # Less of it in the blue, which grass has little of.
            share = to_grey([1.0, 1.0, 0.5]) if grey else 1.0
            dark = self._grass(ray_W, rows, index[rows], p_WC[:2], height, share)
            if not grey:
                dark = cv2.merge((dark, dark, dark >> 1, np.zeros_like(dark)))
            cv2.subtract(small[rows], dark, dst=small[rows])
        # Interpolating to half the size and doubling the pixels takes half the
        # time of interpolating at once.
        return cv2.resize(small, (2 * self._w, 2 * self._h))

    def _ground_rows(self, down) -> slice:
        """The rows in which down @ (u, v, 1) > 0 for at least one u."""
        most = max(0.0, down[0] * (self._w - 1)) + down[1] * np.arange(self._h) + down[2]
        rows = np.flatnonzero(most > 0)
        return slice(rows[0], rows[-1] + 1) if len(rows) else slice(0, 0)

    def _grass(self, ray_W, rows, index, p_WC_xy, height, share):
        """Draws that share of how much darker than its colour the ground is in these rows."""
        # The ground point of a pixel is p_WC + ray * height / (down of the ray).
        to_ground = np.array([ray_W[0], ray_W[1], -ray_W[2] / height])
        to_ground[:, 2] += to_ground[:, 1] * rows.start
        total = None
        for layer, contrast in zip(_LAYERS, self._contrasts):
            # The camera is above the second of four tiles in either direction.
            # Beyond them all contrast has gone.
            origin = p_WC_xy % layer.tile + layer.tile
            H = to_ground.copy()
            H[:2] += origin[:, None] * H[2]
            H[:2] /= layer.texel
            grass = cv2.warpPerspective(
                self._grass_tiles,
                H,
                index.shape[::-1],
                flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
                borderValue=128,
            )
            grass = cv2.multiply(grass, contrast.take(index, mode="wrap"), scale=share / 255)
            total = grass if total is None else cv2.add(total, grass)
        return total

    def _fill_tables(self, height):
        """Fills the ground's half of the tables of colours and contrasts."""
        distance = height / self._sine
        clear = 1.0 - haze(distance)
        ground = clear[:, None] * (np.array(GRASS) - HORIZON) + HORIZON
        # A texture is shown as long as its texels are no smaller than a pixel's
        # footprint, which is longest along the line of sight.
        footprint = distance / self._sine / self._focal
        for layer, table in zip(_LAYERS, self._contrasts):
            contrast = clear * layer.strength / (1 + (footprint / layer.texel / 2) ** 2)
            table[_HALF:] = contrast
            # The texture only darkens: its mean is added to the colour.
            ground += contrast[:, None] * [0.5, 0.5, 0.25]
        self._colors[_HALF:, :3] = np.minimum(ground, 255)


class Backdrop:
    """The background of one picture, to be painted piece by piece."""

    def __init__(self, background: Background, X_WC):
        """Args: background: of all pictures. X_WC: pose of the camera."""
        self._background, self._X_WC = background, X_WC
        self._halves = {}  # by whether they are grey

    def paint(self, out, box) -> None:
        """Fills a box of the picture; see pixels.py."""
        grey = is_grey(out)
        if grey not in self._halves:
            self._halves[grey] = self._background.paint_half(self._X_WC, grey)
        half = self._halves[grey]
        x0, y0, x1, y1 = box
        h, w = half.shape[:2]
        if out.shape[:2] == (2 * h, 2 * w) and not any(edge % 2 for edge in box):
            half = half[y0 // 2:y1 // 2, x0 // 2:x1 // 2]
            if grey:
                # OpenCV has no quick way to double bytes, but merges them quickly.
                wide = cv2.merge((half, half)).reshape(len(half), -1)
                out[y0:y1:2, x0:x1] = out[y0 + 1:y1:2, x0:x1] = wide
            else:
                cv2.resize(half, (x1 - x0, y1 - y0), dst=part(out, box),
                           interpolation=cv2.INTER_NEAREST)
            return
        if half.shape != out.shape:
            size = out.shape[1::-1]
            half = cv2.resize(half, size, interpolation=cv2.INTER_NEAREST)
            self._halves[grey] = half
        part(out, box)[:] = part(half, box)
