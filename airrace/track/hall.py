"""The dark hall around a course: walls, columns, and white lights below the ceiling."""

import itertools
from typing import NamedTuple

import numpy as np
from pydrake.math import RigidTransform

from airrace.track.course import Box
from airrace.track.geometry import point_distances

_MARGIN, _HEADROOM = 8.0, 4.0  # m, beyond the outermost corners of gates, and above them
_WALL = 0.5  # m, thickness of walls and ceiling
_COLUMN, _COLUMN_STEP = 0.6, (12.0, 12.0)  # m, side of a column, and from one to the next
_ROOM = 4.0  # m, from the middle of a column to the way from gate to gate, at least
_LIGHT, _LIGHT_STEP = (1.6, 0.5, 0.06), (8.0, 6.0)  # m, size of a light, and from one to the next
_RIM = 0.08  # m, width of what shines around a light's dark middle


class Hall(NamedTuple):
    """A hall whose floor is the ground."""

    #: low, high: its inner corners (m), (3,)
    low: np.ndarray
    high: np.ndarray
    #: columns, lights: boxes, from the floor to the ceiling, and below the ceiling
    columns: tuple[Box, ...]
    lights: tuple[Box, ...]
    panels: tuple[Box, ...]  #: the dark middles of the lights, a little below them

    def shell(self) -> dict[str, Box]:
        """Returns the walls and the ceiling as boxes around the hall."""
        middle, size = (self.low + self.high) / 2, self.high - self.low
        boxes = {}
        for name, axis, sign in (
            ("wall_east", 0, 1), ("wall_west", 0, -1),
            ("wall_north", 1, 1), ("wall_south", 1, -1), ("ceiling", 2, 1),
        ):  # fmt: skip
            place, extent = middle.copy(), size + 2 * _WALL
            place[axis] += sign * (size[axis] + _WALL) / 2
            extent[axis] = _WALL
            boxes[name] = Box(RigidTransform(place), extent)
        return boxes


def hall_around(outline: np.ndarray, way: np.ndarray) -> Hall:
    """Returns the hall around an outline, (n, 3) m, whose columns keep away from a way, (k, 3) m.

    The same course has the same hall.
    """
    low = np.append(np.floor(outline[:, :2].min(0) - _MARGIN), 0.0)
    high = np.append(
        np.ceil(outline[:, :2].max(0) + _MARGIN), np.ceil(outline[:, 2].max() + _HEADROOM)
    )
    columns = [
        Box(RigidTransform([x, y, high[2] / 2]), np.array([_COLUMN, _COLUMN, high[2]]))
        for x, y in _grid(low, high, _COLUMN_STEP)
        if point_distances(np.array([x, y]), way[:-1, :2], way[1:, :2]).min() >= _ROOM
    ]
    lights = [
        Box(RigidTransform([x, y, high[2] - _LIGHT[2] / 2]), np.array(_LIGHT))
        for x, y in _grid(low, high, _LIGHT_STEP)
    ]
    size, down = np.array(_LIGHT) - [2 * _RIM, 2 * _RIM, 0.0], RigidTransform([0.0, 0.0, -0.01])
    panels = [Box(light.X_WB @ down, size) for light in lights]
    return Hall(low, high, tuple(columns), tuple(lights), tuple(panels))


def _grid(low: np.ndarray, high: np.ndarray, steps: tuple[float, float]) -> list:
    """Returns points on a grid in the middle of the hall, [x, y] (m), none at a wall."""
    axes = []
    for i, step in enumerate(steps):
        count = int((high[i] - low[i]) / step)
        first = (low[i] + high[i] - (count - 1) * step) / 2
        axes.append(first + step * np.arange(count))
    return list(itertools.product(*axes))
