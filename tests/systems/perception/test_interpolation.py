import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.systems.perception.interpolation import as_pixels, grey_levels

IMAGE = np.random.default_rng(0).integers(0, 256, (12, 17)).astype(np.uint8)


def grey_level(x, y):
    levels = grey_levels(IMAGE, np.array([2.0, x, 7.0]), np.array([1.0, y, 4.0]))
    assert levels[0] == IMAGE[1, 2] and levels[2] == IMAGE[4, 7]
    return levels[1]


@given(st.floats(-3, 20), st.floats(-3, 15))
def test_bilinear(x, y):
    expected = cv2.remap(
        IMAGE.astype(np.float32),
        np.float32([[x]]),
        np.float32([[y]]),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    # OpenCV rounds to 1/32 px.
    assert grey_level(x, y) == pytest.approx(float(expected[0, 0]), abs=255 / 32 + 1e-3)


def test_exact_at_pixels_and_halfway():
    assert grey_level(3.0, 5.0) == IMAGE[5, 3]
    assert grey_level(16.0, 11.0) == IMAGE[11, 16]
    assert grey_level(3.5, 5.0) == (int(IMAGE[5, 3]) + int(IMAGE[5, 4])) / 2
    assert grey_level(3.0, 5.5) == (int(IMAGE[5, 3]) + int(IMAGE[6, 3])) / 2


@pytest.mark.parametrize("x, y", [(np.nan, 0.0), (0.0, np.nan), (np.inf, -np.inf), (1e300, 3.0)])
def test_no_pixel_beyond_the_image_is_looked_at(x, y):
    assert 0.0 <= grey_level(x, y) <= 255.0


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (5, 1)])
def test_a_picture_of_one_row_or_column_has_only_its_own_levels(shape):
    image = np.full(shape, 90, np.uint8)
    levels = grey_levels(image, np.array([-1.0, 0.5, 4.0]), np.array([4.0, 0.5, -1.0]))
    assert levels.tolist() == [90.0, 90.0, 90.0]


def test_pictures_are_copied_only_if_need_be():
    assert as_pixels(IMAGE) is IMAGE
    frozen = IMAGE.copy()
    frozen.setflags(write=False)
    for other in (frozen, IMAGE[:, ::2]):
        pixels = as_pixels(other)
        assert pixels.flags.writeable and pixels.flags.c_contiguous
        np.testing.assert_array_equal(pixels, other)
