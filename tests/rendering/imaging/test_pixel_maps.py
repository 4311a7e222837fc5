"""Maps from picture to picture."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from airrace.rendering.imaging.pixel_maps import PixelMap

V, U = np.mgrid[:60, :80].astype(float)
# Turned, stretched, and bent outwards.
BENT = PixelMap(
    20 + 0.9 * U - 0.3 * V + 2e-3 * (U - 40) ** 2, 5 + 0.2 * U + 1.1 * V + 1e-3 * (V - 30) ** 2
)
SOURCE = np.random.default_rng(0).integers(0, 256, (110, 130), np.uint8)


@given(st.integers(0, 78), st.integers(0, 58), st.integers(1, 80), st.integers(1, 60))
def test_a_box_needs_no_more_than_its_source(x0, y0, w, h):
    box = x0, y0, min(x0 + w, 80), min(y0 + h, 60)
    whole, piece = np.zeros((60, 80), np.uint8), np.zeros((60, 80), np.uint8)
    BENT.bend(SOURCE, whole)
    a0, b0, a1, b1 = BENT.source(box, (130, 110))
    hidden = np.zeros_like(SOURCE)
    hidden[b0:b1, a0:a1] = SOURCE[b0:b1, a0:a1]
    BENT.bend(hidden, piece, box)
    inside = np.s_[box[1] : box[3], box[0] : box[2]]
    np.testing.assert_array_equal(piece[inside], whole[inside])
    piece[inside] = 0
    assert not piece.any()


def test_nothing_comes_from_beyond_the_source():
    aside = PixelMap(U - 200.0, V)
    picture = np.full((60, 80, 4), 7, np.uint8)
    aside.bend(np.full((60, 80, 4), 99, np.uint8), picture)
    assert np.all(picture == [0, 0, 0, 255])
    x0, y0, x1, y1 = aside.source((0, 0, 80, 60), (80, 60))
    assert x0 == x1
