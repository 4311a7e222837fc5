"""Camera pictures in messages, as they are or as JPEG, in Drake's lcmt_image_array."""

import math
from typing import Any

import cv2
import numpy as np
from drake import lcmt_image

from airrace.hitl.link.codec import check_finite
from airrace.hitl.link.packets import MALFORMED, OVERSIZED, Dropped
from airrace.lcmtypes import lcmt_pictures
from airrace.recording.pictures import size_of_jpeg
from airrace.systems.sensing.picture_ports import COLOUR, GREY, PICTURE_PORTS

JPEG_QUALITY = 80
_CHANNELS = {GREY: 1, COLOUR: 4}
_PIXEL_FORMATS = {GREY: lcmt_image.PIXEL_FORMAT_GRAY, COLOUR: lcmt_image.PIXEL_FORMAT_RGBA}
_LARGEST = 8192  # px, width and height


def encode_pictures(pictures: dict, time: float, lossless: bool) -> lcmt_pictures:
    """Returns the message of one frame.

    Args:
        pictures: GREY to (h, w), COLOUR to (h, w, 4) as RGBA, uint8; one or both.
        time: when it was taken (s).
        lossless: pixels as they are in the place of JPEG. As PNG, their noise takes a third of
            the time of a race in lockstep.
    """
    message = lcmt_pictures()
    message.time = time
    message.images.images = [_encoded(*each, time, lossless) for each in pictures.items()]
    message.images.num_images = len(pictures)
    return message


def decode_pictures(
    message: lcmt_pictures, shape: tuple[int, int] | None = None
) -> tuple[dict, float]:
    """Returns what encode_pictures() was given: pictures and time.

    A JPEG's are a little different. Nothing is decompressed that is not of the camera's size.

    Args: shape: (h, w) that each picture must have, else Dropped is raised; None: of any camera.
    """
    check_finite(message.time)
    images = {image.header.frame_name: image for image in message.images.images}
    if not images or len(images) < message.images.num_images or not images.keys() <= {GREY, COLOUR}:
        raise Dropped(MALFORMED)
    if shape and any((image.height, image.width) != shape for image in images.values()):
        raise Dropped(MALFORMED)
    return {name: _decoded(image, name) for name, image in images.items()}, message.time


def port_value(port: str, pictures: dict, shape: tuple[int, int]) -> Any:
    """Returns the value of one of PICTURE_PORTS.

    Args: shape: (h, w) that the picture must have, else Dropped is raised.
    """
    kind = PICTURE_PORTS[port]
    picture = pictures.get(kind.picture)
    if picture is None or picture.shape[:2] != tuple(shape):
        raise Dropped(MALFORMED)
    return kind.value_of(picture)


def _encoded(name: str, picture: np.ndarray, time: float, lossless: bool) -> lcmt_image:
    image = lcmt_image()
    image.height, image.width = picture.shape[:2]
    image.header.utime = round(time * 1e6)
    image.header.frame_name = name
    image.channel_type = lcmt_image.CHANNEL_TYPE_UINT8
    image.row_stride = picture.shape[1] * _CHANNELS[name]
    if lossless:
        image.pixel_format = _PIXEL_FORMATS[name]
        image.compression_method = lcmt_image.COMPRESSION_METHOD_NOT_COMPRESSED
        image.data = picture.tobytes()
    else:
        pixels = picture
        image.pixel_format = lcmt_image.PIXEL_FORMAT_GRAY
        if name == COLOUR:  # OpenCV's order is BGR; in the file it is RGB
            pixels = cv2.cvtColor(picture, cv2.COLOR_RGBA2BGR)
            image.pixel_format = lcmt_image.PIXEL_FORMAT_RGB
        image.compression_method = lcmt_image.COMPRESSION_METHOD_JPEG
        _, data = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        image.data = data.tobytes()
    image.size = len(image.data)
    return image


def _decoded(image: lcmt_image, name: str) -> np.ndarray:
    if not all(0 < each <= _LARGEST for each in (image.width, image.height)):
        raise Dropped(OVERSIZED)
    if len(image.data) != image.size:
        raise Dropped(MALFORMED)
    if image.compression_method == lcmt_image.COMPRESSION_METHOD_JPEG:
        return _from_jpeg(image, name)
    shape = (image.height, image.width, _CHANNELS[name])
    is_plain = image.compression_method == lcmt_image.COMPRESSION_METHOD_NOT_COMPRESSED
    if not is_plain or image.size != math.prod(shape):
        raise Dropped(MALFORMED)
    pixels = np.frombuffer(bytearray(image.data), np.uint8)  # writable, see as_pixels()
    return pixels.reshape(shape if name == COLOUR else shape[:2])


def _from_jpeg(image: lcmt_image, name: str) -> np.ndarray:
    if size_of_jpeg(image.data) != (image.width, image.height):  # which OpenCV would believe
        raise Dropped(MALFORMED)
    shape = (image.height, image.width) if name == GREY else (image.height, image.width, 3)
    flag = cv2.IMREAD_GRAYSCALE if name == GREY else cv2.IMREAD_UNCHANGED
    try:
        pixels = cv2.imdecode(np.frombuffer(image.data, np.uint8), flag)
    except cv2.error:
        pixels = None
    if pixels is None or pixels.dtype != np.uint8 or pixels.shape != shape:
        raise Dropped(MALFORMED)
    return pixels if name == GREY else cv2.cvtColor(pixels, cv2.COLOR_BGR2RGBA)
