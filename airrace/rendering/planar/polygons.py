"""Convex polygons with smooth edges: which pixels they cover, and how much of them."""

import math

from airrace.common.jit import compilable

NEAR = 0.05  # nothing nearer to the camera than this is drawn (m)
# Between which distances from an edge, outwards (px), a colour fades out. Facets of one
# body overlap by as much as they fade, or what is behind would shine through the seams.
OVERLAPPING, EXACT = (0.0, 1.0), (-0.5, 0.5)


@compilable
def clip_near(points_h, clipped) -> int:
    """Finds the part of a convex polygon in front of the near plane.

    Args:
        points_h: corners (u z, v z, z), (n, 3): pixel times depth, and depth.
        clipped: where to put the corners of the rest, (u, v) in pixels, (n + 1, 2).

    Returns:
        how many corners it has; 0 if nothing is left.
    """
    n, count = len(points_h), 0
    for i in range(n):
        x, y, z = points_h[i, 0], points_h[i, 1], points_h[i, 2]
        j = i + 1 if i + 1 < n else 0
        after = points_h[j, 2]
        if z >= NEAR:
            clipped[count, 0], clipped[count, 1] = x / z, y / z
            count += 1
        if (z >= NEAR) != (after >= NEAR):
            share = (NEAR - z) / (after - z)
            clipped[count, 0] = (x + share * (points_h[j, 0] - x)) / NEAR
            clipped[count, 1] = (y + share * (points_h[j, 1] - y)) / NEAR
            count += 1
    return count


@compilable
def edge_lines(corners, n, low, high, lines, row) -> int:
    """Finds the lines along the edges of a convex polygon.

    A line is a, b, c such that a x + b y + c is the distance of (x, y) from it, outwards;
    and k, x_low, x_high such that on row y these distances are at columns x_low + k y and
    x_high + k y. Corners that coincide have no line.

    Args:
        corners: (n or more, 2) px. n: how many there are.
        low, high: distances, see spans().
        lines: where to put them, (rows, n or more, 6). row: which row of it.

    Returns:
        how many there are.
    """
    area, count = 0.0, 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        area += corners[i, 0] * corners[j, 1] - corners[i, 1] * corners[j, 0]
    sign = 1.0 if area > 0.0 else -1.0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        x, y = corners[i, 0], corners[i, 1]
        dx, dy = corners[j, 0] - x, corners[j, 1] - y
        length = math.sqrt(dx * dx + dy * dy)
        if length > 1e-6:
            a, b = sign * dy / length, -sign * dx / length
            c = -a * x - b * y
            lines[row, count, 0], lines[row, count, 1], lines[row, count, 2] = a, b, c
            if abs(a) > 1e-9:
                lines[row, count, 3] = -b / a
                lines[row, count, 4] = (low - c) / a
                lines[row, count, 5] = (high - c) / a
            count += 1
    return count


@compilable
def spans(lines, y, low, high, x0, x1):
    """Returns which pixels of a row a polygon touches, and which of them it fills.

    Args:
        lines: of its edges, see edge_lines().
        y: the row.
        low, high: up to where it fills, and from where on it does not touch, px outwards.
        x0, x1: of the columns looked at, the first and the one after the last.

    Returns:
        first and last column that it touches, and that it fills, and none if the
        last is less than the first.
    """
    a0, a1, b0, b1 = float(x0), x1 - 1.0, float(x0), x1 - 1.0
    for i in range(len(lines)):
        a, way = lines[i, 0], lines[i, 3] * y
        if a > 1e-9:
            a1, b1 = min(a1, lines[i, 5] + way), min(b1, lines[i, 4] + way)
        elif a < -1e-9:
            a0, b0 = max(a0, lines[i, 5] + way), max(b0, lines[i, 4] + way)
        else:
            d = lines[i, 1] * y + lines[i, 2]
            if d > high:
                return x0, x0 - 1, x0, x0 - 1
            if d > low:
                b1 = b0 - 1.0
    if not a0 <= a1:
        return x0, x0 - 1, x0, x0 - 1
    first, last = int(math.ceil(a0)), int(math.floor(a1))
    filled, until = int(math.ceil(max(b0, a0))), int(math.floor(min(b1, a1)))
    if filled > until:
        return first, last, last + 1, last
    return first, last, filled, until


@compilable
def cover(lines, x, y, low, high) -> float:
    """Returns how much of a pixel a polygon covers, 0 to 1; see spans()."""
    if low < 0.0 and len(lines) == 4:
        # What opposite edges leave of the pixel in either direction: so a polygon that is
        # smaller than a pixel is as faint as it should be.
        part = 1.0
        for i in range(2):
            left = -1.0
            for k in (i, i + 2):
                d = lines[k, 0] * x + lines[k, 1] * y + lines[k, 2]
                left += min(max((high - d) / (high - low), 0.0), 1.0)
            part *= max(left, 0.0)
        return part
    farthest = low
    for k in range(len(lines)):
        farthest = max(farthest, lines[k, 0] * x + lines[k, 1] * y + lines[k, 2])
    return max(high - farthest, 0.0) / (high - low)


@compilable
def bounds(corners, n, box):
    """Returns the pixels that a polygon can touch, inside of a box.

    Args:
        corners: (n or more, 2) px. n: how many there are.
        box: see pixels.py.
    """
    x0, y0, x1, y1 = box[2], box[3], box[0], box[1]
    for i in range(n):
        x, y = corners[i, 0], corners[i, 1]
        if not abs(x) + abs(y) < 1e8:
            return box[0], box[1], box[2], box[3]
        x0, y0 = min(x0, int(x) - 2), min(y0, int(y) - 2)
        x1, y1 = max(x1, int(x) + 3), max(y1, int(y) + 3)
    return max(x0, box[0]), max(y0, box[1]), min(x1, box[2]), min(y1, box[3])
