"""Takes the lens distortion out of the camera's image."""

import dataclasses as dc
import functools

import cv2
import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.sensors import ImageGrey8U, ImageRgba8U

from airrace.common.immutable import read_only
from airrace.rendering.imaging.lens import PixelMap
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.sensing.camera_view import CameraView
from airrace.vehicle.camera_info import CameraInfo


class Rectifier(LeafSystem):
    """Turns raw images into those of a pinhole camera.

    .. pydrake_system::

        name: Rectifier
        input_ports:
        - camera_image
        - camera_grey
        - camera_view
        - camera_info
        output_ports:
        - camera_image
        - camera_grey
        - camera_view
        - camera_info

    ``camera_image`` is an ImageRgba8U, ``camera_grey`` an ImageGrey8U,
    ``camera_view`` a CameraView and ``camera_info`` a CameraInfo. The
    outputs have the inputs' names, so the Rectifier fits in front of any system
    that reads them: the image is that of K' = P[:, :3] and no distortion,
    seen from the frame that R rotates to, and the info says so. What the lens
    did not see is black.

    An output is a function of the input of its name and of the calibration; an image
    is rectified once, and only if its output is evaluated.
    """

    def __init__(self) -> None:
        LeafSystem.__init__(self)
        # Both depend on the calibration, which never changes.
        self._map = functools.lru_cache(maxsize=1)(_map)
        self._rectified = functools.lru_cache(maxsize=1)(rectified_info)
        images = [
            self.DeclareAbstractInputPort(name, Value(kind()))
            for name, kind in (("camera_image", ImageRgba8U), ("camera_grey", ImageGrey8U))
        ]
        self._info = self.DeclareAbstractInputPort("camera_info", Value[object]())
        for port, kind in zip(images, (ImageRgba8U, ImageGrey8U)):
            self.DeclareAbstractOutputPort(
                port.get_name(),
                lambda kind=kind: Value(kind()),
                functools.partial(self._calc_image, port),
                {port.ticket(), self._info.ticket()},
            )
        self._view = self.DeclareAbstractInputPort("camera_view", Value[object]())
        self.DeclareAbstractOutputPort(
            "camera_view",
            lambda: Value[object](),
            self._calc_view,
            {self._view.ticket(), self._info.ticket()},
        )
        self.DeclareAbstractOutputPort(
            "camera_info", lambda: Value[object](), self._calc_info, {self._info.ticket()}
        )

    def _calc_image(self, port, context, output):
        info = self._info.Eval(context)
        image = output.get_mutable_value()
        image.resize(info.width, info.height)
        self._map(info).bend(port.Eval(context).data, image.mutable_data)

    def _calc_view(self, context, output):
        raw, pixel_map = self._view.Eval(context), self._map(self._info.Eval(context))
        h, w = raw.shape

        def draw(out, boxes):
            picture = raw.drawn(*(pixel_map.source(box, (w, h)) for box in boxes))
            for box in boxes:
                pixel_map.bend(picture, out, box)

        output.set_value(CameraView(pixel_map.shape, draw))

    def _calc_info(self, context, output):
        output.set_value(self._rectified(self._info.Eval(context)))


def _map(info: CameraInfo) -> PixelMap:
    """Returns the place of every pixel in the raw image."""
    return PixelMap(
        *cv2.initUndistortRectifyMap(
            info.K, info.D, info.R, info.P[:, :3], (info.width, info.height), cv2.CV_32FC1
        )
    )


def rectified_info(info: CameraInfo) -> CameraInfo:
    """Returns the calibration of the rectified images of a camera."""
    K = read_only(info.P[:, :3].copy())
    R_CR = RotationMatrix(info.R).inverse()  # R rotates into the rectified frame
    return dc.replace(
        info,
        K=K,
        D=read_only(np.zeros(5)),
        R=read_only(np.eye(3)),
        P=read_only(np.column_stack([K, np.zeros(3)])),
        X_BC=info.X_BC @ RigidTransform(R_CR, np.zeros(3)),
    )
