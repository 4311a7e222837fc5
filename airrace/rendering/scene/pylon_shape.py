"""The pylon as a polyhedron: a striped cone with a rounded tip."""

import functools
from typing import NamedTuple

import numpy as np

from airrace.rendering.scene.textures import PYLON_COLOR, STRIPE_COLOR, shade
from airrace.track import PYLON_BASE_RADIUS, PYLON_HEIGHT, PYLON_TIP_RADIUS

STRIPES = ((2.4, 4.8), (7.2, 9.6))  # heights between which the pylon is white (m)


class PylonShape(NamedTuple):
    """A pylon whose foot is at the origin, z up."""

    vertices: np.ndarray  #: (v, 3) (m)
    normals: np.ndarray  #: normals of the round surface at the vertices, (v, 3)
    sides: int  #: of the cone
    #: Vertex numbers, counter-clockwise seen from outside, (f, 4): first the flank, a facet a side;
    #: then the tip; then the flank once more, a facet a side and stripe.
    facets: np.ndarray
    surface: int  #: how many of them are flank and tip
    facet_normals: np.ndarray  #: (f, 3)
    facet_offsets: np.ndarray  #: normal times any point of the facet, (f,)
    facet_colors: np.ndarray  #: sunlit RGB, (f, 3), 0 to 255


def _profile(tip_rings: int) -> np.ndarray:
    """The outline from foot to tip: rows of height, radius, slope of the normal."""
    centre = PYLON_HEIGHT - PYLON_TIP_RADIUS
    # The flank touches the tip's sphere: its normal rises by such an angle
    # that the distance of the line through (base radius, 0) is the tip's radius.
    to_centre = np.hypot(PYLON_BASE_RADIUS, centre)
    slope = np.arctan2(PYLON_BASE_RADIUS, centre) - np.arcsin(PYLON_TIP_RADIUS / to_centre)
    heights = [0.0, *np.ravel(STRIPES)]
    flank = [(z, PYLON_BASE_RADIUS - z * np.tan(slope), slope) for z in heights]
    slopes = np.linspace(slope, np.pi / 2, tip_rings + 1)
    # The last ring keeps a small radius: its facets need an area.
    slopes[1:] -= 0.1 * (np.arange(1, tip_rings + 1) == tip_rings)
    z, r = centre + PYLON_TIP_RADIUS * np.sin(slopes), PYLON_TIP_RADIUS * np.cos(slopes)
    return np.concatenate([flank, np.column_stack([z, r, slopes])])


@functools.cache
def make_pylon_shape(sides: int, tip_rings: int) -> PylonShape:
    """Returns a pylon; tip_rings: rings of facets on the tip; none cuts the tip off."""
    profile = _profile(tip_rings)
    angle = 2 * np.pi * np.arange(sides) / sides
    around = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(sides)])
    up = np.array([0.0, 0.0, 1.0])
    # Half of the polygon lies inside the circle and half outside.
    widen = np.cos(np.pi / sides) ** -0.5
    vertices = np.concatenate([widen * r * around + z * up for z, r, _ in profile])
    normals = np.concatenate([np.cos(s) * around + np.sin(s) * up for *_, s in profile])

    def between(low, high):
        """Facets between two rings."""
        i = np.arange(sides)
        j = (i + 1) % sides
        return np.column_stack(
            [low * sides + i, low * sides + j, high * sides + j, high * sides + i]
        )

    flank_top = 1 + 2 * len(STRIPES)
    tip = range(flank_top, flank_top + tip_rings)
    surface = [between(0, flank_top), *(between(k, k + 1) for k in tip)]
    stripes = [between(k, k + 1) for k in range(flank_top)]
    facets = np.concatenate(surface + stripes)

    a, b, d = (vertices[facets[:, k]] for k in (0, 1, 3))
    facet_normals = np.cross(b - a, d - a)
    facet_normals /= np.linalg.norm(facet_normals, axis=1)[:, None]
    striped = [PYLON_COLOR, STRIPE_COLOR] * len(STRIPES) + [PYLON_COLOR]
    colors = np.repeat([PYLON_COLOR] * len(surface) + striped, sides, axis=0)
    return PylonShape(
        vertices=vertices,
        normals=normals,
        sides=sides,
        facets=facets,
        surface=sides * len(surface),
        facet_normals=facet_normals,
        facet_offsets=np.sum(facet_normals * a, axis=1),
        facet_colors=shade(colors, facet_normals),
    )
