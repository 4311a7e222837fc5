"""Pictures in messages: exact if they must be, near if not, and none that claims too much."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.hitl.link import image_messages
from airrace.hitl.link.packets import Dropped, Stamp, pack, unpack
from airrace.hitl.link.probe import texture
from airrace.lcmtypes import lcmt_pictures

SHAPE = (48, 80)


def through(found, lossless, time=1 / 3):
    data = pack(image_messages.encode_pictures(found, time, lossless), Stamp(1, 1, 0.5))
    message, _ = unpack(data, lcmt_pictures)
    return image_messages.decode_pictures(message)


@given(seed=st.integers(0, 1000), time=st.floats(0.0, 1e6))
def test_lossless_is_exact(seed, time):
    noise = np.random.Generator(np.random.PCG64(seed))
    found = {
        image_messages.GREY: noise.integers(0, 256, SHAPE, np.uint8),
        image_messages.COLOUR: noise.integers(0, 256, (*SHAPE, 4), np.uint8),
    }
    again, when = through(found, lossless=True, time=time)
    assert when == time and set(again) == set(found)
    for name, picture in found.items():
        np.testing.assert_array_equal(again[name], picture)
        assert again[name].flags.writeable  # or each compiled function that looks at it copies it


def test_a_jpeg_in_grey_is_no_picture_in_colour():
    message = image_messages.encode_pictures({image_messages.GREY: texture(*SHAPE)}, 0.0, False)
    message.images.images[0].header.frame_name = image_messages.COLOUR
    with pytest.raises(Dropped):
        image_messages.decode_pictures(message)


def test_jpeg_is_near_and_small():
    grey = texture(480, 640)
    colour = np.dstack([grey, 255 - grey, grey // 2, np.full_like(grey, 255)])
    again, _ = through({image_messages.GREY: grey, image_messages.COLOUR: colour}, lossless=False)
    assert np.abs(again[image_messages.GREY].astype(int) - grey).mean() < 5
    assert np.abs(again[image_messages.COLOUR].astype(int) - colour).mean() < 8
    assert len(image_messages.encode_pictures({"grey": grey}, 0.0, False).encode()) < grey.size / 4


def test_as_the_ports_have_them():
    grey = texture(*SHAPE)
    colour = np.dstack([grey] * 4)
    found = {image_messages.GREY: grey, image_messages.COLOUR: colour}
    np.testing.assert_array_equal(
        image_messages.port_value("camera_view", found, SHAPE).whole(), grey
    )
    np.testing.assert_array_equal(
        image_messages.port_value("camera_grey", found, SHAPE).data[..., 0], grey
    )
    np.testing.assert_array_equal(
        image_messages.port_value("camera_image", found, SHAPE).data, colour
    )
    for port in image_messages.PICTURE_PORTS:
        with pytest.raises(Dropped):
            image_messages.port_value(port, found, (SHAPE[0], SHAPE[1] + 1))
        with pytest.raises(Dropped):
            image_messages.port_value(port, {}, SHAPE)


@pytest.mark.parametrize("lossless", [True, False])
def test_a_picture_of_another_camera_is_not_decompressed(lossless, monkeypatch):
    found = {image_messages.GREY: texture(*SHAPE)}
    message = image_messages.encode_pictures(found, 0.0, lossless)
    assert image_messages.decode_pictures(message, SHAPE)
    monkeypatch.setattr(image_messages, "_decoded", pytest.fail)
    with pytest.raises(Dropped):
        image_messages.decode_pictures(message, SHAPE[::-1])


def test_a_progressive_jpeg_is_none():
    """Each of its scans takes as long as a whole picture."""
    message = image_messages.encode_pictures({image_messages.GREY: texture(*SHAPE)}, 0.0, False)
    image = message.images.images[0]
    progressive = [cv2.IMWRITE_JPEG_PROGRESSIVE, 1]
    image.data = cv2.imencode(".jpg", texture(*SHAPE), progressive)[1].tobytes()
    image.size = len(image.data)
    with pytest.raises(Dropped):
        image_messages.decode_pictures(message)


@pytest.mark.parametrize("lossless", [True, False])
@pytest.mark.parametrize(
    "change",
    [
        {"width": 81},
        {"height": 0},
        {"width": 100_000},
        {"size": 3},
        {"compression_method": 3},
        {"data": b"", "size": 0},
        {"data": b"\xff\xd8\xff\xc0", "size": 4},
    ],
)
def test_what_a_message_claims_must_be_so(change, lossless):
    message = image_messages.encode_pictures({image_messages.GREY: texture(*SHAPE)}, 0.0, lossless)
    for name, value in change.items():
        setattr(message.images.images[0], name, value)
    with pytest.raises(Dropped):
        image_messages.decode_pictures(message)


@pytest.mark.parametrize(
    "name, time", [("", 0.0), ("red", 0.0), ("grey", np.nan), ("grey", np.inf)]
)
def test_names_and_times(name, time):
    message = image_messages.encode_pictures({image_messages.GREY: texture(*SHAPE)}, 0.0, True)
    message.time, message.images.images[0].header.frame_name = time, name
    with pytest.raises(Dropped):
        image_messages.decode_pictures(message)


def test_no_picture_comes_twice():
    message = image_messages.encode_pictures({image_messages.GREY: texture(*SHAPE)}, 0.0, True)
    message.images.images *= 2
    message.images.num_images = 2
    with pytest.raises(Dropped):
        image_messages.decode_pictures(message)
