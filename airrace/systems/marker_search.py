"""Finds markers in pictures with OpenCV, in all of it or in regions."""

import cv2
import numpy as np

from airrace.systems.camera_view import CameraView
from airrace.systems.marker_modules import DICTIONARY

_SMALLEST_SIDE = 15.0  # px, of a square whose modules can be told apart
# A region is the marker's predicted bounding box and this much around it: for the
# board, and for what a drone that rolls may move it beyond the prediction.
_MARGIN = 40.0  # px
_RELATIVE_MARGIN = 0.3  # in sizes of the box


class MarkerSearch:
    """OpenCV's detector, set up for the boards."""

    def __init__(self):
        self._detector = make_detector()

    def everywhere(self, image):
        """Searches a picture.

        Args:
            image: grey levels, (h, w), uint8.

        Returns:
            IDs, list of n; and rough corners, top left first, clockwise as the
            marker is read, (n, 4, 2) px.
        """
        return self._Detect(image)

    def around(self, view: CameraView, predictions):
        """Searches a picture near where markers are expected.

        Args:
            view: of the picture.
            predictions: corners expected, list of (4, 2) px.

        Returns:
            as everywhere().
        """
        h, w = view.shape
        regions, found = [], {}
        for box in predictions:
            low, high = box.min(axis=0), box.max(axis=0)
            margin = _MARGIN + _RELATIVE_MARGIN * (high - low)
            x0, y0 = np.clip(np.floor(low - margin), 0, (w, h)).astype(int).tolist()
            x1, y1 = np.clip(np.ceil(high + margin), 0, (w, h)).astype(int).tolist()
            if x1 - x0 >= _SMALLEST_SIDE and y1 - y0 >= _SMALLEST_SIDE:
                regions.append((x0, y0, x1, y1))
        picture = view.drawn(*regions)
        for x0, y0, x1, y1 in regions:
            ids, quads = self._Detect(picture[y0:y1, x0:x1])
            # Regions overlap, so a marker may be found in several of them.
            found.update(zip(ids, quads + [x0, y0]))
        return list(found), np.reshape(list(found.values()), (-1, 4, 2))

    def _Detect(self, grey):
        parameters = self._detector.getDetectorParameters()
        # OpenCV counts perimeters in lengths of the picture's longer side.
        parameters.minMarkerPerimeterRate = 4 * _SMALLEST_SIDE / max(grey.shape)
        self._detector.setDetectorParameters(parameters)
        quads, ids, _ = self._detector.detectMarkers(grey)
        if ids is None:
            return [], np.zeros((0, 4, 2))
        return np.ravel(ids).tolist(), np.reshape(quads, (-1, 4, 2)).astype(float)


def make_detector() -> cv2.aruco.ArucoDetector:
    """Returns OpenCV's detector with parameters for the boards.

    The boards are black on white: one threshold window, and a constant above
    OpenCV's 7 that passes over most of grass and sky, spare two thirds of the
    time of OpenCV's default and lose no markers; a larger constant loses them
    in the dark, a smaller window under blur. Slivers are left out, because
    OpenCV spends milliseconds on reading one. Modules of small markers are read
    at twice the default resolution. OpenCV's own refinements pull corners
    inwards and cost time: see corner_refit.py.
    """
    parameters = cv2.aruco.DetectorParameters()
    parameters.adaptiveThreshWinSizeMin = parameters.adaptiveThreshWinSizeMax = 7
    parameters.adaptiveThreshConstant = 10
    parameters.minCornerDistanceRate = 0.1  # of the perimeter
    parameters.perspectiveRemovePixelPerCell = 8
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE
    return cv2.aruco.ArucoDetector(DICTIONARY, parameters)
