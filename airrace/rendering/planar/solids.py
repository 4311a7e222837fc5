"""Square gates and halls as polygons: flat faces, back to front."""

import typing

import numpy as np

from airrace.common.jit import compilable
from airrace.math.small_matrices import product
from airrace.math.vec3 import dot
from airrace.rendering.images import touches
from airrace.rendering.planar.polygons import EXACT, end_at_seam, set_polygon, with_grey
from airrace.rendering.planar.projection import View, bounding_box, clip_near
from airrace.rendering.scene.solids import Faces, solids_of
from airrace.track import Course

_NUMBERS = np.arange(4)
_NOTHING = Faces(np.empty((0, 4, 3)), np.empty((0, 3)), np.empty(0, bool))


class Solids(typing.NamedTuple):
    """All solids of a course, of which there may be none; the first are behind all others.

    Within a solid, no face that is seen hides another one; solids hide each other by their
    distances. Both hold for frames and columns that keep apart.
    """

    behind: int  #: how many these are; they are drawn in their order
    #: corners, normals, colors, mitred: of all faces, (f, 4, 3) m, (f, 3), (f, 5) and (f,)
    corners: np.ndarray
    normals: np.ndarray
    colors: np.ndarray
    mitred: np.ndarray
    starts: np.ndarray  #: the first face of each solid, and the end of the last, (k + 1,)
    #: low, high: of boxes around the solids along the world's axes, (k, 3) m
    low: np.ndarray
    high: np.ndarray


def make_solids(track: Course) -> Solids:
    """Returns the solids of a course."""
    behind, others = solids_of(track)
    every = [*behind, *others, _NOTHING]
    return Solids(
        len(behind),
        np.concatenate([faces.corners for faces in every]),
        np.concatenate([faces.normals for faces in every]),
        with_grey(np.concatenate([faces.colors for faces in every])),
        np.concatenate([faces.mitred for faces in every]),
        np.cumsum([0, *(len(faces.corners) for faces in behind + others)]),
        np.array([faces.corners.min((0, 1)) for faces in behind + others]).reshape(-1, 3),
        np.array([faces.corners.max((0, 1)) for faces in behind + others]).reshape(-1, 3),
    )


@compilable
def add_solid(
    polygons: np.ndarray, n: int, solids: Solids, i: int, p_WC: np.ndarray, view: View
) -> int:
    """Adds the faces of solid i that are seen from p_WC; returns how many polygons there are."""
    corners = np.empty((5, 2))
    for f in range(solids.starts[i], solids.starts[i + 1]):
        if dot(solids.normals[f], p_WC - solids.corners[f, 0]) <= 0.0:
            continue
        count = clip_near(product(solids.corners[f] - p_WC, view.P.T), _NUMBERS, corners)
        box = bounding_box(corners, count, view.picture)
        if count >= 3 and touches(box, view.parts):
            set_polygon(polygons[n], corners, count, EXACT, solids.colors[f], box)
            if solids.mitred[f]:
                end_at_seam(polygons[n], 0)
                end_at_seam(polygons[n], 2)
            n += 1
    return n
