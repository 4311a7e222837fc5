"""Finds marker boards in the camera's image."""

import cv2
import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import LeafSystem
from pydrake.systems.sensors import ImageRgba8U

from airrace.immutable import read_only
from airrace.systems.types import CameraInfo, Detection, Detections
from airrace.track import MARKER_SIZE


class ArucoDetector(LeafSystem):
    """Detects ArUco markers and their poses in the camera frame.

    .. pydrake_system::

        name: ArucoDetector
        input_ports:
        - camera_image
        - camera_image_time
        - camera_info
        output_ports:
        - detections

    ``camera_image`` is an ImageRgba8U, ``camera_image_time`` when it was
    taken (s), ``camera_info`` a CameraInfo; ``detections`` a Detections.

    The output is a function of the inputs alone: Drake's cache makes sure
    that an image is searched once, however many look at the detections.
    """

    def __init__(self):
        LeafSystem.__init__(self)
        self._detector = make_detector()
        self._image = self.DeclareAbstractInputPort("camera_image", Value(ImageRgba8U()))
        self._time = self.DeclareVectorInputPort("camera_image_time", 1)
        self._info = self.DeclareAbstractInputPort("camera_info", Value[object]())
        self.DeclareAbstractOutputPort(
            "detections",
            lambda: Value[object](Detections()),
            self._CalcDetections,
            {self._image.ticket(), self._time.ticket(), self._info.ticket()},
        )

    def _CalcDetections(self, context, output):
        info = self._info.Eval(context)
        image = cv2.cvtColor(self._image.Eval(context).data, cv2.COLOR_RGBA2GRAY)
        corners, ids, _ = self._detector.detectMarkers(image)
        markers = () if ids is None else tuple(
            detection
            for quad, id in zip(corners, np.ravel(ids).tolist())
            if (detection := locate(id, quad.reshape(4, 2), info)) is not None
        )
        output.set_value(Detections(float(self._time.Eval(context)[0]), markers))


def make_detector() -> cv2.aruco.ArucoDetector:
    """Returns OpenCV's detector, set up for the boards.

    The boards are black on white: one threshold window with a large constant
    passes over grass and sky, which saves four fifths of the time of OpenCV's
    default and loses few markers, all of them small.
    """
    parameters = cv2.aruco.DetectorParameters()
    parameters.adaptiveThreshWinSizeMin = parameters.adaptiveThreshWinSizeMax = 7
    parameters.adaptiveThreshConstant = 20
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    return cv2.aruco.ArucoDetector(
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_ARUCO_ORIGINAL), parameters
    )


def locate(id: int, corners, info: CameraInfo, size: float = MARKER_SIZE) -> Detection | None:
    """Solves the pose of one marker from its corners.

    Collins and Bartoli, "Infinitesimal plane-based pose estimation", IJCV
    2014, as OpenCV's SOLVEPNP_IPPE_SQUARE: of its two solutions, the one
    with the smaller reprojection error.

    Args:
        id: the marker's ID.
        corners: (4, 2) px; top left, top right, bottom right, bottom left.
        info: the camera.
        size: side of the black square (m).

    Returns:
        the detection, or None if there is no pose in front of the camera.
    """
    h = size / 2
    points = np.array([[-h, h, 0], [h, h, 0], [h, -h, 0], [-h, -h, 0]])
    corners = np.asarray(corners, float)
    count, rotations, translations, errors = cv2.solvePnPGeneric(
        points, corners, info.K, info.D, flags=cv2.SOLVEPNP_IPPE_SQUARE
    )
    if not count or not np.isfinite(translations[0]).all() or translations[0][2] <= 0:
        return None
    # OpenCV's rotation is a float product; projecting keeps Drake's checks happy.
    R_CM = RotationMatrix.ProjectToRotationMatrix(cv2.Rodrigues(rotations[0])[0])
    return Detection(
        id=id,
        corners=read_only(corners),
        X_CM=RigidTransform(R_CM, translations[0].ravel()),
        reprojection_error=float(np.ravel(errors)[0]),
    )
