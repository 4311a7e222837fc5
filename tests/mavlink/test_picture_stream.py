import cv2
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from airrace.mavlink.telemetry import PICTURE_HEADER, encode_picture, picture_datagrams


@given(st.binary(min_size=1, max_size=5000), st.integers(1, 1500), st.integers(0, 2**32 - 1))
def test_a_picture_is_put_together_again(jpeg, chunk_size, frame):
    parts = list(picture_datagrams(frame, 123456789, jpeg, chunk_size))
    headers = [PICTURE_HEADER.unpack(part[:24]) for part in parts]
    assert PICTURE_HEADER.size == 24
    assert [h[1] for h in headers] == list(range(len(parts)))
    assert {(h[0], h[2], h[3], h[5]) for h in headers} == {
        (frame, len(parts), len(jpeg), 123456789)
    }
    assert all(len(part) == 24 + h[4] <= 24 + chunk_size for part, h in zip(parts, headers))
    assert b"".join(part[24:] for part in parts) == jpeg


def test_the_header_is_little_endian():
    (part,) = picture_datagrams(1, 2, b"xyz", 10)
    assert (
        part
        == b"\1\0\0\0" + b"\0\0" + b"\1\0" + b"\3\0\0\0" + b"\3\0\0\0" + b"\2" + 7 * b"\0" + b"xyz"
    )


def test_a_small_picture_is_filled_up_and_is_the_same():
    picture = np.full((36, 64, 4), 255, np.uint8)
    picture[:, :30, :3] = 251, 53, 6
    for size in (68_000, 200_000):
        jpeg = encode_picture(picture, 90, size)
        assert len(jpeg) == size and jpeg[:2] == b"\xff\xd8" and jpeg[-2:] == b"\xff\xd9"
        plain, filled = (
            cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
            for data in (encode_picture(picture, 90), jpeg)
        )
        np.testing.assert_array_equal(plain, filled)


def test_colours_are_kept():
    picture = np.full((36, 64, 4), 255, np.uint8)
    picture[..., :3] = 255, 112, 16  # a gate's
    decoded = cv2.imdecode(np.frombuffer(encode_picture(picture, 90), np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_allclose(decoded.reshape(-1, 3).mean(0), [16, 112, 255], atol=3)
