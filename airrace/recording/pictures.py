"""Pictures that others may have written, in JPEG."""

import cv2
import numpy as np

_LARGEST = 8192  # px, width and height


def decoded(jpeg: bytes) -> np.ndarray | None:
    """Returns the grey levels of a JPEG, (h, w) uint8; None if it is none, or is too large."""
    width, height = size_of_jpeg(jpeg) or (0, 0)
    if not (0 < width <= _LARGEST and 0 < height <= _LARGEST):
        return None
    try:
        return cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
    except cv2.error:
        return None


def size_of_jpeg(data: bytes) -> tuple[int, int] | None:
    """Returns width and height that a JPEG says it has (px), None if it is none.

    Nor of a progressive one: each of its scans, a hundred bytes, takes as long as a whole picture,
    and OpenCV writes none unless it is asked to.
    """
    at = 2
    while data[:2] == b"\xff\xd8" and at + 9 < len(data) and data[at] == 0xFF:
        if data[at + 1] in (0xC0, 0xC1):  # start of frame
            return int.from_bytes(data[at + 7 : at + 9]), int.from_bytes(data[at + 5 : at + 7])
        at += 2 + int.from_bytes(data[at + 2 : at + 4])
    return None
