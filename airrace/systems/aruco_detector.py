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

# The marker's corners in a frame F that is M turned half a turn about x: a
# marker that faces the camera then has no rotation, where M has one of pi,
# which OpenCV's rotation vectors cannot represent well.
_H = MARKER_SIZE / 2
_POINTS = np.array([[-_H, -_H, 0.0], [_H, -_H, 0.0], [_H, _H, 0.0], [-_H, _H, 0.0]])
_TILT = 0.4  # rad
_R_FM = RotationMatrix(np.diag([1.0, -1.0, -1.0]))


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


def locate(id: int, corners, info: CameraInfo) -> Detection | None:
    """Solves the pose of one marker from its corners.

    Collins and Bartoli, "Infinitesimal plane-based pose estimation", IJCV
    2014, as OpenCV's SOLVEPNP_IPPE, then Levenberg-Marquardt: of the two
    solutions, the one with the smaller reprojection error.

    Args:
        id: the marker's ID.
        corners: (4, 2) px; top left, top right, bottom right, bottom left.
        info: the camera.

    Returns:
        the detection, or None if there is no pose in front of the camera.
    """
    corners = np.asarray(corners, float)
    if not np.isfinite(corners).all() or cv2.contourArea(corners.astype(np.float32)) < 1.0:
        return None
    _, rotations, translations, _ = cv2.solvePnPGeneric(
        _POINTS, corners, info.K, info.D, flags=cv2.SOLVEPNP_IPPE
    )
    seeds = [
        (r, t) for r, t in zip(rotations, translations) if np.isfinite(r).all() and t[2, 0] > 0
    ]
    best, best_error = None, np.inf
    for r, t in seeds or _guesses(corners, info):
        r, t = cv2.solvePnPRefineLM(_POINTS, corners, info.K, info.D, r, t)
        projected = cv2.projectPoints(_POINTS, r, t, info.K, info.D)[0].reshape(4, 2)
        error = np.sqrt(np.mean(np.sum((projected - corners) ** 2, axis=1)))
        if error < best_error and t[2, 0] > 0:
            best, best_error = (r, t), error
    if best is None:
        return None
    # A rotation matrix from OpenCV is not orthonormal enough for Drake.
    R_CF = RotationMatrix.ProjectToRotationMatrix(cv2.Rodrigues(best[0])[0])
    return Detection(
        id=id,
        corners=read_only(corners),
        X_CM=RigidTransform(R_CF @ _R_FM, best[1].ravel()),
        reprojection_error=float(best_error),
    )


def _guesses(corners, info: CameraInfo):
    """Returns rough poses, for views of perfect symmetry where IPPE finds none."""
    depth = MARKER_SIZE * info.K[0, 0] / np.ptp(corners, axis=0).max()
    t = depth * np.linalg.solve(info.K, [*corners.mean(axis=0), 1.0])
    return [
        (np.array([[a], [b], [0.0]]), t[:, None].copy())
        for a, b in ((_TILT, 0), (-_TILT, 0), (0, _TILT), (0, -_TILT))
    ]
