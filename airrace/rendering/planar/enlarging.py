"""Enlarges soft pictures."""

import numpy as np

from airrace.common.jit import compiled


@compiled
def enlarge(small, out, box):
    """Draws a box of a large picture: interpolates to half its size, and doubles pixels.

    Args:
        small: (h, w, channels).
        out: the large one, (height, width, channels), about four times as large.
        box: see pixels.py, (4,).
    """
    h, w, channels = small.shape
    height, width = out.shape[:2]
    x0, y0, x1, y1 = box
    quick = channels in (1, 4) and width == 4 * w and x0 % 4 == 0 and x1 % 4 == 0
    j0, j1 = x0 * w // width, (x1 - 1) * w // width + 1
    flat, source = out.reshape(height, -1), small.reshape(h, -1)
    # What is interpolated between rows, of columns j0 - 1 to j1.
    blend = np.empty((j1 - j0 + 2) * channels, np.uint16)
    first, second = np.empty(len(blend), np.uint8), np.empty(len(blend), np.uint8)
    before = -1
    for y in range(y0, y1):
        half = y * 2 * h // height
        row = flat[y, x0 * channels : x1 * channels]
        if half == before:
            row[:] = flat[y - 1, x0 * channels : x1 * channels]
            continue
        before = half
        near = half // 2
        far = min(max(near + (1 if half % 2 else -1), 0), h - 1)
        a = source[near, j0 * channels : j1 * channels]
        b = source[far, j0 * channels : j1 * channels]
        middle = blend[channels:-channels]
        for k in range(len(a)):
            middle[k] = np.uint16(3) * np.uint16(a[k]) + np.uint16(b[k])
        for j, k in ((max(j0 - 1, 0), 0), (min(j1, w - 1), j1 - j0 + 1)):
            for c in range(channels):
                blend[k * channels + c] = np.uint16(
                    3 * int(small[near, j, c]) + int(small[far, j, c])
                )
        if quick:
            left, right = blend[: -2 * channels], blend[2 * channels :]
            for k in range(len(a)):
                centre = np.uint16(3) * middle[k] + np.uint16(8)
                first[k] = np.uint8((centre + left[k]) >> 4)
                second[k] = np.uint8((centre + right[k]) >> 4)
            if channels == 1:
                pairs = row.view(np.uint16)
                for k in range(len(a)):
                    pairs[2 * k] = first[k] * np.uint16(257)
                    pairs[2 * k + 1] = second[k] * np.uint16(257)
                continue
            pixels, firsts, seconds = (
                row.view(np.uint32),
                first.view(np.uint32),
                second.view(np.uint32),
            )
            for j in range(j1 - j0):
                pixels[4 * j] = pixels[4 * j + 1] = firsts[j]
                pixels[4 * j + 2] = pixels[4 * j + 3] = seconds[j]
            continue
        for x in range(x0, x1):
            half_x = x * 2 * w // width
            k = half_x // 2 - j0 + 1
            aside = k + (1 if half_x % 2 else -1)
            for c in range(channels):
                level = 3 * int(blend[k * channels + c]) + int(blend[aside * channels + c])
                row[(x - x0) * channels + c] = np.uint8((level + 8) >> 4)
