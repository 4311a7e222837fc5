import cv2
import numpy as np
import pytest

from airrace.recording.pictures import decoded, size_of_jpeg

JPEG = cv2.imencode(".jpg", np.full((36, 64), 128, np.uint8))[1].tobytes()


def sized(width, height):
    """JPEG with a header that says another size."""
    at = JPEG.index(b"\xff\xc0")
    size = height.to_bytes(2) + width.to_bytes(2)
    return JPEG[: at + 5] + size + JPEG[at + 9 :]


def test_a_picture():
    assert size_of_jpeg(JPEG) == (64, 36)
    assert decoded(JPEG).shape == (36, 64) and np.ptp(decoded(JPEG)) == 0


PROGRESSIVE = cv2.imencode(
    ".jpg", np.full((36, 64), 128, np.uint8), [cv2.IMWRITE_JPEG_PROGRESSIVE, 1]
)[1].tobytes()


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xff\xd8",
        b"no picture at all",
        JPEG[:40],
        sized(65000, 65000),
        sized(9000, 16),
        PROGRESSIVE,
    ],
)
def test_what_is_none_or_too_large(data):
    assert decoded(data) is None
