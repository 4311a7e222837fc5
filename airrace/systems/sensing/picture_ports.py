"""The ports on which the camera's picture is to be had, and what they hold."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from pydrake.systems.sensors import ImageGrey8U, ImageRgba8U

from airrace.systems.sensing.camera_view import CameraView

# Kinds of pictures: grey levels, (h, w), and RGBA, (h, w, 4), both uint8.
GREY, COLOUR = "grey", "colour"


class PicturePort(NamedTuple):
    """A port of pictures."""

    picture: str  #: the kind that it shows
    pixels_of: Callable[[Any], np.ndarray]  #: from its value to pixels
    value_of: Callable[[np.ndarray], Any]  #: from pixels to its value


def _image_of(kind: type) -> Callable[[np.ndarray], Any]:
    def value_of(pixels):
        image = kind(pixels.shape[1], pixels.shape[0])
        image.mutable_data[:] = pixels.reshape(image.data.shape)
        return image

    return value_of


PICTURE_PORTS = {
    "camera_view": PicturePort(GREY, lambda view: view.whole(), CameraView.of),
    "camera_grey": PicturePort(GREY, lambda image: image.data[..., 0], _image_of(ImageGrey8U)),
    "camera_image": PicturePort(COLOUR, lambda image: image.data, _image_of(ImageRgba8U)),
}
# Of ports whose values are images of C++.
IMAGE_TYPES = {"camera_grey": ImageGrey8U, "camera_image": ImageRgba8U}
