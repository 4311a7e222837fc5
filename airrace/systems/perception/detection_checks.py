"""Reasons to refuse what looks like a marker."""

import math
from typing import Any

import cv2
import numpy as np

from airrace.systems.perception.marker_modules import misread_modules
from airrace.systems.types import Detection
from airrace.vehicle.camera_info import CameraInfo

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
_MOST_REFIT, _MOST_REFIT_SHARE = 3.0, 0.1  # px, and of the square's width
_MOST_MISREAD = 2  # modules; another ID has at least three
# What a drone can do between two images.
_MAX_SPEED = 30.0  # m/s
_MAX_TURN_RATE = 15.0  # rad/s
_JUMP_SIGMAS = 6.0
_LONGEST_GAP = 0.2  # s, between images that can be compared


def check_view(view: Any, time: float, info: CameraInfo) -> str | None:
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


def check_quad(quad: np.ndarray) -> str | None:
    """Returns why rough corners are no marker's, None if they may be.

    Args: quad: as the marker is read, (4, 2) px.
    """
    area = _signed_area(quad)
    if area < 0:
        return FROM_BEHIND
    if area < _LEAST_AREA:
        return TINY
    return None if cv2.isContourConvex(quad.astype(np.float32)) else NON_CONVEX


def check_corners(corners: np.ndarray, quad: np.ndarray) -> str | None:
    """Returns why refitted corners are wrong, None if they may be right.

    Args:
        corners: (4, 2) px; NaN where there is no edge.
        quad: what they were refitted from, (4, 2) px.
    """
    # A refit that moves farther has followed the edges of something else.
    limit = _MOST_REFIT + _MOST_REFIT_SHARE * math.sqrt(_signed_area(quad))
    return None if np.abs(corners - quad).max() < limit else NO_EDGES


def check_id(grey: np.ndarray, corners: np.ndarray, id: int) -> str | None:
    """Returns why a marker's ID is wrong, None if it may be right.

    Args: grey, corners, id: see misread_modules().
    """
    return MISREAD if misread_modules(grey, corners, id) > _MOST_MISREAD else None


def swapped_pair(id: int, left: np.ndarray, right: np.ndarray) -> bool:
    """Whether a gate's two markers are on the wrong sides of each other.

    A camera in front of their faces cannot see that.

    Args:
        id: of the marker on the left pylon, as the gate is flown through.
        left, right: corners of the markers on the two pylons, (4, 2) px.
    """
    rightward = left[1] - left[0] + left[2] - left[3]
    return bool(rightward @ (right - left).sum(axis=0) > 0) == bool(id % 2)


def jumps(detection: Detection, before: Detection, dt: float) -> bool:
    """Whether no drone can move so between two detections of a marker.

    The distance does not depend on the camera's attitude, so it is compared by
    itself, and then the attitude.

    Args: detection, before: of the same marker. dt: time between them (s).
    """
    if not 0 < dt <= _LONGEST_GAP:
        return False
    moved = abs(_distance(detection) - _distance(before))
    turn = detection.X_CM.rotation() @ before.X_CM.rotation().inverse()
    turned = abs(turn.ToAngleAxis().angle())
    assert detection.covariance is not None and before.covariance is not None  # ours have it
    variances = (detection.covariance.diagonal() + before.covariance.diagonal()).tolist()
    turn_sigma, position_sigma = math.sqrt(sum(variances[:3])), math.sqrt(sum(variances[3:]))
    return (
        moved > _MAX_SPEED * dt + _JUMP_SIGMAS * position_sigma
        or turned > _MAX_TURN_RATE * dt + _JUMP_SIGMAS * turn_sigma
    )


def _distance(detection: Detection) -> float:
    """Returns that of a marker from the camera (m)."""
    return math.hypot(*detection.X_CM.translation().tolist())


def _signed_area(quad: np.ndarray) -> float:
    """Area (px^2) within corners, negative if they run anticlockwise as seen."""
    (ax, ay), (bx, by) = (quad[2] - quad[0]).tolist(), (quad[3] - quad[1]).tolist()
    return (ax * by - ay * bx) / 2
