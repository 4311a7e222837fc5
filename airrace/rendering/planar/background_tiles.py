"""Tiles of the background, many pixels at a time.

A tile is computed in short loops, each over all its pixels: a processor then works on
several of them at once. Only the texture is fetched pixel by pixel.
"""

import math

import numpy as np

from airrace.common.jit import compiled

HALF = 1024  # entries of the look-up tables on either side of the horizon
TILE_W, TILE_H = 16, 12
_BYTE = np.uint32(255)


@compiled
def draw_tiles(
    small,
    done,
    boxes,
    width,
    height,
    ray_W,
    shortening,
    x,
    y,
    above,
    colors,
    darkening,
    grass,
    texels,
):
    """Draws those tiles of a small picture that boxes of the large one need.

    Args:
        small: (h, w, channels). done: which of its tiles are drawn.
        boxes: (n, 4). width, height: of the large picture.
        ray_W: maps (u, v, 1) to the ray's direction in the world, (3, 3).
        shortening: 1 / length of the rays, (h, w).
        x, y, above: where the camera is (m).
        colors, darkening: see Background.tables().
        grass: see grass_squares(). texels: their sizes (m), by layer, (2,).
    """
    h, w, _ = small.shape
    size = TILE_H * TILE_W
    x_W, y_W, right, down = np.zeros(size), np.zeros(size), np.empty(size), np.empty(size)
    coarse, fine = np.empty(size), np.empty(size)
    entries, places = np.empty(size, np.int32), np.empty(size, np.int32)
    squares = np.empty(size, np.uint32)
    for x0, y0, x1, y1 in boxes:
        # One pixel more is needed to either side, to interpolate.
        i0, i1 = max(y0 * h // height - 1, 0), min((y1 - 1) * h // height + 1, h - 1)
        j0, j1 = max(x0 * w // width - 1, 0), min((x1 - 1) * w // width + 1, w - 1)
        for i in range(i0 // TILE_H, i1 // TILE_H + 1):
            for j in range(j0 // TILE_W, j1 // TILE_W + 1):
                if not done[i, j]:
                    done[i, j] = True
                    v, u = i * TILE_H, j * TILE_W
                    _find_ground(x_W, y_W, entries, u, v, ray_W, shortening, x, y, above)
                    _look_up(coarse, x_W, y_W, texels[0], grass, right, down, places, squares)
                    _look_up(fine, x_W, y_W, texels[1], grass, right, down, places, squares)
                    _mix(
                        small[v : v + TILE_H, u : u + TILE_W],
                        entries,
                        colors,
                        darkening,
                        coarse,
                        fine,
                    )


@compiled
def _find_ground(x_W, y_W, entries, u0, v0, ray_W, shortening, x, y, above):
    """Finds where the rays of a tile's pixels meet the ground.

    Args:
        x_W, y_W: where to put that (m), (n,).
        entries: where to put those of the look-up tables, (n,).
        u0, v0: the first pixel. What is beyond the picture is left as it is.
        Others: see draw_tiles().
    """
    h, w = shortening.shape
    count = min(TILE_W, w - u0)
    for i in range(min(TILE_H, h - v0)):
        v, first = v0 + i, i * TILE_W
        x_v, y_v = ray_W[0, 1] * v + ray_W[0, 2], ray_W[1, 1] * v + ray_W[1, 2]
        z_v = ray_W[2, 1] * v + ray_W[2, 2]
        shorter = shortening[v, u0 : u0 + count]
        for k in range(count):
            u = u0 + k
            down = -(ray_W[2, 0] * u + z_v)
            entries[first + k] = np.int32((HALF - 1) * down * shorter[k] + HALF)
            # The ground point is p_WC + ray * height / (down of the ray).
            along = above / max(down, 1e-9)
            x_W[first + k] = x + along * (ray_W[0, 0] * u + x_v)
            y_W[first + k] = y + along * (ray_W[1, 0] * u + y_v)


@compiled
def _look_up(levels, x_W, y_W, texel, grass, right, down, places, squares):
    """Finds the texture of grass at points of the ground, between texels bilinearly.

    Where that is too far away for 32 bits, it is any texture: no grass shows there.

    Args:
        levels: where to put it, (n,).
        x_W, y_W: the points (m), (n,).
        texel: its size (m).
        grass: see draw_tiles().
        right, down, places, squares: scratch, (n,).
    """
    size, per_texel = int(math.sqrt(len(grass))), 1.0 / texel
    last = np.int32(size - 1)
    for k in range(len(levels)):
        p, q = x_W[k] * per_texel, y_W[k] * per_texel
        a, b = np.floor(p), np.floor(q)
        right[k], down[k] = p - a, q - b
        places[k] = (np.int32(b) & last) * np.int32(size) + (np.int32(a) & last)
    for k in range(len(levels)):
        squares[k] = grass[np.uint32(places[k])]
    for k in range(len(levels)):
        square = squares[k]
        here = float(np.int32(square & _BYTE))
        aside = float(np.int32((square >> np.uint32(8)) & _BYTE))
        below = float(np.int32((square >> np.uint32(16)) & _BYTE))
        across = float(np.int32(square >> np.uint32(24)))
        top = here + right[k] * (aside - here)
        bottom = below + right[k] * (across - below)
        levels[k] = top + down[k] * (bottom - top)


@compiled
def _mix(tile, entries, colors, darkening, coarse, fine):
    """Sets the pixels of a tile, (h, w, channels), as dark as two layers of grass say."""
    h, w, channels = tile.shape
    for i in range(h):
        for c in range(channels):
            for k in range(w):
                n = i * TILE_W + k
                level = colors[entries[n], c] + 0.5
                level -= coarse[n] * darkening[entries[n], 0, c]
                level -= fine[n] * darkening[entries[n], 1, c]
                tile[i, k, c] = np.uint8(np.int32(max(level, 0.0)))
