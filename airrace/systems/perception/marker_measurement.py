"""From quads to detections: corners, checks, poses."""

import dataclasses as dc
import math
from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np

from airrace.systems.perception import detection_checks as checks
from airrace.systems.perception.corner_refit import FARTHEST_SAMPLE, refit
from airrace.systems.perception.marker_pose import CORNER_SIGMA, locate, locate_alone, locate_gate
from airrace.systems.sensing.camera_view import CameraView
from airrace.vehicle.camera_info import CameraInfo

_OPENCV_COVARIANCE = CORNER_SIGMA**2 * np.eye(8)  # px^2, of one marker's corners


@dc.dataclass(frozen=True)
class DetectorConfig:
    """Settings of detect() and of its parts."""

    max_id: float = math.inf  #: greater IDs are refused
    #: Shortest and longest period of full searches (images); (1, 1) for a full search of every
    #: image.
    full_search_periods: tuple[int, int] = (8, 16)
    #: "refit" (corner_refit.py), or "opencv" for the corners that OpenCV's detector refines
    #: (CORNER_REFINE_SUBPIX).
    corners: str = "refit"
    #: "gate" for the joint pose of a gate's two markers where both are seen, or "marker" for
    #: OpenCV's pose of every marker by itself; see marker_pose.py.
    poses: str = "gate"
    jump_filter: bool = True  #: whether markers whose pose jumps are refused


def measure(
    view: CameraView,
    ids: Sequence[int],
    quads: np.ndarray,
    info: CameraInfo,
    config: DetectorConfig = DetectorConfig(),
) -> tuple[tuple, tuple]:
    """Refits, checks and locates markers.

    Args:
        view: of the image.
        ids: of n markers.
        quads: their corners, (n, 4, 2) px: rough ones, unless config.corners is "opencv".
        info: the camera.
        config: settings.

    Returns: tuple of Detection by ID, and tuple of (reason, ID) of what was refused.
    """
    refused, candidates = [], []
    for id, quad in zip(ids, quads):
        if reason := checks.FOREIGN_ID if id > config.max_id else checks.check_quad(quad):
            refused.append((reason, id))
        else:
            candidates.append((id, quad))
    quads = [quad for _, quad in candidates]
    grey, passed = _drawn_around(quads, view), []
    if config.corners == "opencv":
        corners_and_covariances = quads, [_OPENCV_COVARIANCE] * len(quads)
    else:
        corners_and_covariances = refit(grey, quads)
    for (id, quad), corners, covariance in zip(candidates, *corners_and_covariances):
        if reason := checks.check_corners(corners, quad) or checks.check_id(grey, corners, id):
            refused.append((reason, id))
        else:
            passed.append((id, corners, covariance))
    usable = {id: (corners, covariance) for id, corners, covariance in passed}
    for id, count in Counter(id for id, *_ in passed).items():
        if count > 1:
            refused += count * [(checks.SEEN_TWICE, id)]
            del usable[id]
    for left, right in _pairs(usable):
        if checks.swapped_pair(left, usable[left][0], usable[right][0]):
            refused += [(checks.FROM_BEHIND, left), (checks.FROM_BEHIND, right)]
            del usable[left], usable[right]
    located = _locate_all(usable, info, config.poses)
    refused += [(checks.NO_POSE, id) for id in sorted(usable.keys() - located.keys())]
    return tuple(located[id] for id in sorted(located)), tuple(refused)


def _drawn_around(quads: Sequence[np.ndarray], view: CameraView) -> np.ndarray:
    """Returns an image that is valid wherever refit() and check_id() sample these quads."""
    h, w = view.shape
    return view.drawn(
        *(
            (
                max(int(min(x) - FARTHEST_SAMPLE), 0),
                max(int(min(y) - FARTHEST_SAMPLE), 0),
                min(int(max(x) + FARTHEST_SAMPLE), w),
                min(int(max(y) + FARTHEST_SAMPLE), h),
            )
            for x, y in (quad.T.tolist() for quad in quads)
        )
    )


def _pairs(ids: Iterable[int]) -> list:
    """Returns the IDs of a gate's left and right markers on the same face."""
    return [(id, id + 2) for id in sorted(ids) if id % 4 < 2 and id + 2 in ids]


def _locate_all(usable: dict, info: CameraInfo, poses: str) -> dict:
    """Returns ID to Detection of all that have a pose.

    Args: usable: ID to corners and their covariance. info: the camera. poses: see DetectorConfig.
    """
    if poses == "marker":
        alone = (locate_alone(id, corners, info) for id, (corners, _) in usable.items())
        return {detection.id: detection for detection in alone if detection is not None}
    located = {}
    for pair in _pairs(usable):
        corners, covariances = zip(*(usable[id] for id in pair))
        located.update(locate_gate(pair, corners, covariances, info))
    for id in usable.keys() - located.keys():
        detection = locate(id, *usable[id], info)  # type: ignore[call-arg]
        if detection is not None:
            located[id] = detection
    return located
