"""From rough quads to checked poses."""

from collections import Counter

from airrace.systems.perception import detection_checks as checks
from airrace.systems.perception.corner_refit import FARTHEST_SAMPLE, refit
from airrace.systems.perception.marker_pose import locate, locate_gate
from airrace.systems.sensing.camera_view import CameraView
from airrace.systems.types import CameraInfo


def measure(view: CameraView, ids, quads, info: CameraInfo, max_id):
    """Refits, checks and locates markers.

    Args:
        view: of the image.
        ids: of n markers.
        quads: their rough corners, (n, 4, 2) px.
        info: the camera.
        max_id: IDs beyond it are refused.

    Returns:
        tuple of Detection by ID, and tuple of (reason, ID) of what was refused.
    """
    refused, likely = [], []
    for id, quad in zip(ids, quads):
        reason = checks.FOREIGN_ID if id > max_id else checks.check_quad(quad)
        if reason is None:
            likely.append((id, quad))
        else:
            refused.append((reason, id))
    grey, passed = _drawn_around([quad for _, quad in likely], view), []
    for (id, quad), corners, covariance in zip(likely, *refit(grey, [q for _, q in likely])):
        reason = checks.check_corners(corners, quad) or checks.check_id(grey, corners, id)
        if reason is None:
            passed.append((id, corners, covariance))
        else:
            refused.append((reason, id))
    usable = {id: rest for id, *rest in passed}
    for id, count in Counter(id for id, *_ in passed).items():
        if count > 1:
            refused += count * [(checks.SEEN_TWICE, id)]
            del usable[id]
    for pair in _pairs(usable):
        if checks.swapped_pair(pair[0], *(usable[id][0] for id in pair)):
            refused += [(checks.FROM_BEHIND, id) for id in pair]
            usable = {id: rest for id, rest in usable.items() if id not in pair}
    located = _locate_all(usable, info)
    refused += [(checks.NO_POSE, id) for id in sorted(usable.keys() - located.keys())]
    return tuple(located[id] for id in sorted(located)), tuple(refused)


def _drawn_around(quads, view: CameraView):
    """Returns an image that is valid where refit() and check_id() look for these quads."""
    h, w = view.shape
    reach = FARTHEST_SAMPLE
    boxes = [
        (
            max(int(min(x) - reach), 0),
            max(int(min(y) - reach), 0),
            min(int(max(x) + reach), w),
            min(int(max(y) + reach), h),
        )
        for x, y in (quad.T.tolist() for quad in quads)
    ]
    return view.drawn(*boxes)


def _pairs(ids) -> list:
    """Returns the IDs of a gate's left and right markers on the same face."""
    return [(id, id + 2) for id in sorted(ids) if id % 4 < 2 and id + 2 in ids]


def _locate_all(usable: dict, info: CameraInfo) -> dict:
    """Returns ID to Detection of all that have a pose.

    Args:
        usable: ID to corners and their covariance.
        info: the camera.
    """
    located = {}
    for pair in _pairs(usable):
        corners, covariances = zip(*(usable[id] for id in pair))
        located.update(locate_gate(pair, corners, covariances, info))
    for id in usable.keys() - located.keys():
        detection = locate(id, *usable[id], info)
        if detection is not None:
            located[id] = detection
    return located
