"""Square gates and a hall as plain coloured solids: what both renderers draw of them.

A solid is a list of flat faces with four corners each. Its colours are as they appear: gates and
lights glow, and what they shine upon is as good as even.
"""

from typing import NamedTuple

import numpy as np

from airrace.track import Course
from airrace.track.course import Box
from airrace.track.hall import Hall
from airrace.track.square_gate import DEPTH, INNER, OUTER, SquareGate

# Red-orange, hue 6 of OpenCV's, as entrants measured it on the official simulator.
GATE_COLOR = (251.0, 53.0, 6.0)
GATE_SIDE_COLOR = (211.0, 44.0, 5.0)  # of the faces along the flight
LETTER_COLOR = (255.0, 255.0, 255.0)
PANEL_COLOR = (16.0, 16.0, 20.0)  # of the dark middle of a light
LIGHT_COLOR = (255.0, 252.0, 244.0)
COLUMN_COLOR = (46.0, 47.0, 53.0)
COLUMN_SHADE = (38.0, 39.0, 45.0)  # of its sides to east and west
FLOOR_COLORS = ((34.0, 34.0, 38.0), (27.0, 27.0, 31.0))  # of two kinds of tiles
WALL_COLORS = ((24.0, 25.0, 30.0), (18.0, 19.0, 24.0))
CEILING_COLORS = ((13.0, 13.0, 16.0), (10.0, 10.0, 13.0))
_TILE = 4.0  # m, about the side of tiles of the floor, the walls and the ceiling


class Faces(NamedTuple):
    """Flat faces, seen from one side only."""

    corners: np.ndarray  #: (f, 4, 3) m, world, counter-clockwise as they are seen
    colors: np.ndarray  #: RGB, (f, 3)
    #: Whether the first and the third edge of each face are joints with faces of the same plane,
    #: which must not be seen, (f,).
    mitred: np.ndarray

    @property
    def normals(self) -> np.ndarray:
        """Unit vectors towards those who see a face, (f, 3)."""
        normals = np.cross(
            self.corners[:, 1] - self.corners[:, 0], self.corners[:, 3] - self.corners[:, 0]
        )
        return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def solids_of(track: Course) -> tuple[list[Faces], list[Faces]]:
    """Returns what solids there are to see of a course, in two lists.

    First what is behind everything else, in the order to draw it: room and lights; then solids
    that hide each other by their distance: columns and gates.
    """
    hall = track.hall()
    gates = [gate_faces(gate) for gate in track.frames()]
    if hall is None:
        return [], gates
    lights = [
        _joined(box_faces(light, [LIGHT_COLOR] * 6), box_faces(panel, [PANEL_COLOR] * 6))
        for light, panel in zip(hall.lights, hall.panels)
    ]
    colors = [COLUMN_SHADE] * 2 + [COLUMN_COLOR] * 4
    columns = [box_faces(box, colors) for box in hall.columns]
    return [room_faces(hall), *lights], columns + gates


def gate_faces(gate: SquareGate) -> Faces:
    """Returns the 16 faces of a frame: front, back, outside and inside; and its lettering."""
    back, front = DEPTH / 2, -DEPTH / 2
    square = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])  # clockwise from in front
    rings = {
        (x, side): np.column_stack([np.full(4, x), side / 2 * square])
        for x in (front, back)
        for side in (OUTER, INNER)
    }
    faces, colors = [], []
    for i in range(4):
        j = (i + 1) % 4
        for (a, b), color in (
            (((front, OUTER), (front, INNER)), GATE_COLOR),
            (((back, INNER), (back, OUTER)), GATE_COLOR),
            (((back, OUTER), (front, OUTER)), GATE_SIDE_COLOR),
            (((front, INNER), (back, INNER)), GATE_SIDE_COLOR),
        ):
            outer, inner = rings[a], rings[b]
            faces.append([outer[i], inner[i], inner[j], outer[j]])
            colors.append(color)
    corners = np.array(faces)
    world = np.array([(gate.X_WG @ face.T).T for face in corners])
    frame = Faces(world, np.array(colors), np.array([color == GATE_COLOR for color in colors]))
    letters = [_seen_of(box_faces(box, [LETTER_COLOR] * 6), gate) for box in gate.letters()]
    return _joined(frame, *letters)


def _seen_of(letter: Faces, gate: SquareGate) -> Faces:
    """Returns the one face of a letter that looks away from the middle of its gate."""
    away = np.einsum("ij,ij->i", letter.corners.mean(1) - gate.p_WG, letter.normals)
    is_seen = np.abs(letter.normals @ gate.forward) * away
    i = int(is_seen.argmax())
    return Faces(*(part[i : i + 1] for part in letter))


def _joined(*faces: Faces) -> Faces:
    return Faces(*map(np.concatenate, zip(*faces)))


def box_faces(box: Box, colors: list) -> Faces:
    """Returns the faces of a box; colors: RGB, of its sides at +x, -x, +y, -y, +z and -z."""
    faces = []
    for axis in range(3):
        u, v = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
        for sign in (1.0, -1.0):
            middle = sign * np.eye(3)[axis]
            u_seen = sign * u  # so that all faces turn the same way
            square = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
            faces.append([middle + a * u_seen + b * v for a, b in square])
    corners = np.array(faces) * box.size / 2
    return Faces(
        np.array([(box.X_WB @ face.T).T for face in corners]), np.array(colors), np.zeros(6, bool)
    )


def room_faces(hall: Hall) -> Faces:
    """Returns the inside of a hall in tiles of two colours, by whose joints motion is seen."""
    low, high = hall.low, hall.high
    x, y, z = np.eye(3)
    sides = (  # a corner of each, and the axes from there, whose product is towards the inside
        (low, x, y, FLOOR_COLORS),
        (np.array([low[0], low[1], high[2]]), y, x, CEILING_COLORS),
        (low, z, x, WALL_COLORS),
        (np.array([low[0], high[1], low[2]]), x, z, WALL_COLORS),
        (low, y, z, WALL_COLORS),
        (np.array([high[0], low[1], low[2]]), z, y, WALL_COLORS),
    )
    faces, painted = [], []
    for origin, u, v, colors in sides:
        m, n = (max(1, round(float(axis @ (high - low)) / _TILE)) for axis in (u, v))
        du, dv = u * (u @ (high - low)) / m, v * (v @ (high - low)) / n
        for i in range(m):
            for j in range(n):
                corners = ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))
                faces.append([origin + a * du + b * dv for a, b in corners])
                painted.append(colors[(i + j) % 2])
    return Faces(np.array(faces), np.array(painted), np.zeros(len(faces), bool))
