"""Pictures as JPEG, cut into the datagrams of the AI Grand Prix's stream."""

import struct
from collections.abc import Iterator

import cv2
import numpy as np

# frame_id, chunk_id, total_chunks, jpeg_size, payload_size, sim_time_ns; little-endian.
HEADER = struct.Struct("<IHHIIQ")


def encode(picture: np.ndarray, quality: int) -> bytes:
    """Returns a picture, RGBA (h, w, 4), as JPEG of a quality from 1 to 100."""
    bgr = cv2.cvtColor(picture, cv2.COLOR_RGBA2BGR)
    _, jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return jpeg.tobytes()


def datagrams(frame_id: int, time_ns: int, jpeg: bytes, chunk_size: int) -> Iterator[bytes]:
    """Yields the datagrams of a picture.

    Args:
        frame_id: number of the picture. time_ns: when it was taken (ns).
        jpeg: the picture. chunk_size: bytes of it in one datagram, at most.
    """
    total = -(-len(jpeg) // chunk_size)
    for i in range(total):
        part = jpeg[i * chunk_size : (i + 1) * chunk_size]
        header = HEADER.pack(
            frame_id % 2**32, i, total, len(jpeg), len(part), max(time_ns, 0) % 2**64
        )
        yield header + part
