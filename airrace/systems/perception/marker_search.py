"""Finds markers with OpenCV in a whole picture or in regions of it."""

import cv2
import numpy as np

from airrace.systems.perception.marker_modules import DICTIONARY, read_marker
from airrace.systems.sensing.camera_view import CameraView

_SMALLEST_SIDE = 15.0  # px, of a square whose modules can be told apart
# A region is the marker's predicted bounding box and this much around it, in px and in
# sizes of the box: for the board, and for the motion that the prediction does not know.
# A marker that is not found in the smaller region is searched for in the larger one.
_MARGINS = ((18.0, 0.1), (25.0, 0.3))
_LEAST_SHARE = 0.5  # of the expected perimeter: modules look like squares, too
# OpenCV compares a square with one ID after the other, 1.5 us each, so it only gets the
# IDs of most tracks.
_USUAL = cv2.aruco.Dictionary(DICTIONARY.bytesList[:80], DICTIONARY.markerSize, 0)
_ALL = cv2.aruco.Dictionary(DICTIONARY.bytesList, DICTIONARY.markerSize, 0)


class MarkerSearch:
    """OpenCV's detector, set up for the boards."""

    def __init__(self, *, refine: bool = False):
        """Args: refine: whether OpenCV refines the corners."""
        self._detector = make_detector(refine)
        # OpenCV refines the corners of those only that it reads itself.
        self._usual = _ALL if refine else _USUAL

    def everywhere(self, image: np.ndarray) -> tuple[list, np.ndarray]:
        """Searches a whole picture.

        Args: image: grey levels, (h, w), uint8.

        Returns:
            IDs, list of n; and corners, top left first, clockwise as the marker is read,
            (n, 4, 2) px; rough ones unless they are refined.
        """
        self._detector.setDictionary(self._usual)
        ids, quads, rest = self._detect(image, 4 * _SMALLEST_SIDE)
        for id, quad in filter(None, (read_marker(image, quad) for quad in rest)):
            if id >= len(self._usual.bytesList):
                ids, quads = [*ids, id], np.concatenate([quads, [quad]])
        return ids, quads

    def around(
        self, view: CameraView, predictions: dict[int, np.ndarray]
    ) -> tuple[list, np.ndarray]:
        """Searches a picture for markers near their predicted corners.

        Args: view: of the picture. predictions: ID to predicted corners, (4, 2) px.

        Returns: as everywhere().
        """
        if not predictions:
            return [], np.zeros((0, 4, 2))
        expected, found = np.array(list(predictions), int), {}
        codes = DICTIONARY.bytesList[expected]
        self._detector.setDictionary(cv2.aruco.Dictionary(codes, DICTIONARY.markerSize, 0))
        for margins in _MARGINS:
            regions = [
                (*_region(box, *margins, view.shape), box)
                for id, box in predictions.items()
                if id not in found
            ]
            regions = [
                (x0, y0, x1, y1, box)
                for x0, y0, x1, y1, box in regions
                if min(x1 - x0, y1 - y0) >= _SMALLEST_SIDE
            ]
            picture = view.drawn(*(region[:4] for region in regions))
            for x0, y0, x1, y1, box in regions:
                perimeter = _LEAST_SHARE * cv2.arcLength(box.astype(np.float32), True)
                ids, quads, _ = self._detect(
                    picture[y0:y1, x0:x1], max(perimeter, 4 * _SMALLEST_SIDE)
                )
                # Regions overlap, so a marker may be found in several of them.
                found.update(zip(expected[ids].tolist(), quads + [x0, y0]))
        return list(found), np.reshape(list(found.values()), (-1, 4, 2))

    def _detect(self, grey, least_perimeter):
        parameters = self._detector.getDetectorParameters()
        # OpenCV counts perimeters in lengths of the picture's longer side.
        parameters.minMarkerPerimeterRate = least_perimeter / max(grey.shape)
        self._detector.setDetectorParameters(parameters)
        quads, ids, rest = self._detector.detectMarkers(grey)
        quads, rest = (np.reshape(each, (-1, 4, 2)).astype(float) for each in (quads, rest))
        return [] if ids is None else np.ravel(ids).tolist(), quads, rest


def _region(
    box: np.ndarray, margin: float, relative_margin: float, shape: tuple[int, ...]
) -> tuple[int, int, int, int]:
    """Returns the part of a picture to search for a marker; see CameraView.region().

    Args:
        box: the marker's corners expected, (4, 2) px.
        margin, relative_margin: around them, in px and in sizes of their bounding box.
        shape: of the picture, (h, w).
    """
    ends = []
    for coordinates, size in zip(box.T.tolist(), shape[::-1]):
        low, high = min(coordinates), max(coordinates)
        around = margin + relative_margin * (high - low)
        ends.append([min(max(round(end), 0), size) for end in (low - around, high + around)])
    (x0, x1), (y0, y1) = ends
    return x0, y0, x1, y1


def make_detector(refine: bool) -> cv2.aruco.ArucoDetector:
    """Returns OpenCV's detector with parameters for the boards.

    The boards are black on white. One threshold window, and a constant above OpenCV's 7
    that ignores most of grass and sky, take a third of the time of OpenCV's default and
    lose no markers; a larger constant loses them in the dark, a smaller window under
    blur. Slivers are left out, because OpenCV spends milliseconds on reading one. Modules
    of small markers are read at twice the default resolution. OpenCV's own refinements
    pull corners inwards: see corner_refit.py.

    Args: refine: whether it refines the corners all the same, by CORNER_REFINE_SUBPIX.
    """
    parameters = cv2.aruco.DetectorParameters()
    parameters.adaptiveThreshWinSizeMin = parameters.adaptiveThreshWinSizeMax = 7
    parameters.adaptiveThreshConstant = 10
    parameters.minCornerDistanceRate = 0.1  # of the perimeter
    parameters.perspectiveRemovePixelPerCell = 8
    parameters.cornerRefinementMethod = (
        cv2.aruco.CORNER_REFINE_SUBPIX if refine else cv2.aruco.CORNER_REFINE_NONE
    )
    return cv2.aruco.ArucoDetector(DICTIONARY, parameters)
