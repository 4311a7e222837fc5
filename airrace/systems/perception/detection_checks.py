"""Reasons to doubt what looks like a marker."""

import math

import cv2
import numpy as np

from airrace.common.jit import compiled
from airrace.systems.perception.marker_modules import misread_modules
from airrace.systems.types import CameraInfo, Detection

WRONG_IMAGE = "wrong size or type of image"
NO_TIME = "no time stamp"
FOREIGN_ID = "foreign ID"
SEEN_TWICE = "ID seen twice"
NO_EDGES = "no clear edges"
MISREAD = "misread ID"
TINY = "tiny quad"
NON_CONVEX = "non-convex quad"
FROM_BEHIND = "seen from behind"
NO_POSE = "no pose"
JUMP = "pose jumps"

_LEAST_AREA = 100.0  # px^2
_FARTHEST_REFIT, _FARTHEST_SHARE = 3.0, 0.1  # px, and of the square's width
_MOST_MISREAD = 2  # modules; another ID has at least three
# What a drone can do between two images.
_MAX_SPEED = 30.0  # m/s
_MAX_TURN_RATE = 15.0  # rad/s
_JUMP_SIGMAS = 6.0
_LONGEST_GAP = 0.2  # s, between images that can be compared


def check_view(view, time, info: CameraInfo) -> str | None:
    """Returns why an image cannot be searched, None if it can.

    Args:
        view: should be a CameraView of (info.height, info.width) pixels, uint8.
        time: when it was taken (s).
        info: the camera.
    """
    if getattr(view, "dtype", None) != np.uint8:
        return WRONG_IMAGE
    if view.shape != (info.height, info.width):
        return WRONG_IMAGE
    return None if np.isfinite(time) else NO_TIME


def check_quad(quad) -> str | None:
    """Returns why rough corners are no marker's, None if they may be.

    Args:
        quad: as the marker is read, (4, 2) px.
    """
    area = _signed_area(quad)
    if area < 0:
        return FROM_BEHIND
    if area < _LEAST_AREA:
        return TINY
    return None if cv2.isContourConvex(quad.astype(np.float32)) else NON_CONVEX


def check_corners(corners, quad) -> str | None:
    """Returns why refitted corners are not to be believed, None if they are.

    Args:
        corners: (4, 2) px; NaN where there is no edge.
        quad: what they were refitted from, (4, 2) px.
    """
    # A refit that runs away has followed the edges of something else.
    limit = _FARTHEST_REFIT + _FARTHEST_SHARE * math.sqrt(_signed_area(quad))
    return None if _farthest(corners, quad) < limit else NO_EDGES


def check_id(grey, corners, id) -> str | None:
    """Returns why a marker's ID is not to be believed, None if it is.

    Args:
        grey, corners, id: see misread_modules().
    """
    return MISREAD if misread_modules(grey, corners, id) > _MOST_MISREAD else None


def swapped_pair(id, left, right) -> bool:
    """Whether a gate's two markers are on the wrong sides of each other.

    No camera in front of their faces can see that.

    Args:
        id: of the marker on the left pylon, as the gate is flown through.
        left, right: corners of the markers on the two pylons, (4, 2) px.
    """
    return _is_to_the_right(left, right) == bool(id % 2)


def jumps(detection: Detection, before: Detection, dt: float) -> bool:
    """Whether no drone can move so between two observations of a marker.

    The distance does not depend on the camera's attitude, so it is compared by
    itself, and then the attitude.

    Args:
        detection, before: of the same marker.
        dt: time between them (s).
    """
    if not 0 < dt <= _LONGEST_GAP:
        return False
    moved = abs(_distance(detection) - _distance(before))
    turn = detection.X_CM.rotation() @ before.X_CM.rotation().inverse()
    turned = abs(turn.ToAngleAxis().angle())
    variances = (detection.covariance.diagonal() + before.covariance.diagonal()).tolist()
    return moved > _MAX_SPEED * dt + _JUMP_SIGMAS * math.sqrt(
        sum(variances[3:])
    ) or turned > _MAX_TURN_RATE * dt + _JUMP_SIGMAS * math.sqrt(sum(variances[:3]))


def _distance(detection: Detection) -> float:
    """Returns that of a marker from the camera (m)."""
    return math.hypot(*detection.X_CM.translation().tolist())


@compiled
def _signed_area(quad):
    """Area (px^2) within corners, negative if they run anticlockwise as seen."""
    x, y = quad[2, 0] - quad[0, 0], quad[2, 1] - quad[0, 1]
    u, v = quad[3, 0] - quad[1, 0], quad[3, 1] - quad[1, 1]
    return (x * v - y * u) / 2


@compiled
def _farthest(corners, quad):
    """Returns how far from each other coordinates are at most (px); NaN if one is."""
    farthest = 0.0
    for i in range(4):
        for j in range(2):
            distance = abs(corners[i, j] - quad[i, j])
            if math.isnan(distance):
                return distance
            farthest = max(farthest, distance)
    return farthest


@compiled
def _is_to_the_right(left, right):
    """Whether one marker is, as the other is read, to the right of it; corners, (4, 2) px."""
    along, towards = np.zeros(2), np.zeros(2)
    for j in range(2):
        along[j] = left[1, j] - left[0, j] + left[2, j] - left[3, j]
        for i in range(4):
            towards[j] += right[i, j] - left[i, j]
    return along[0] * towards[0] + along[1] * towards[1] > 0
