"""Settings of the detector."""

import dataclasses as dc
import math

# Shortest and longest period of full searches (images), see ArucoDetector.
PERIODS = 8, 16


@dc.dataclass(frozen=True)
class DetectorConfig:
    """Settings of detect() and of its parts.

    Attributes:
        max_id: greater IDs are refused.
        full_search_periods: shortest and longest period of full searches (images);
            (1, 1) for a full search of every image.
        corners: "refit" (corner_refit.py), or "opencv" for the corners that OpenCV's detector
            refines (CORNER_REFINE_SUBPIX).
        poses: "gate" for the joint pose of a gate's two markers where both are seen, or
            "marker" for OpenCV's pose of every marker by itself; see marker_pose.py.
        jump_filter: whether markers whose pose jumps are refused.
    """

    max_id: float = math.inf
    full_search_periods: tuple[int, int] = PERIODS
    corners: str = "refit"
    poses: str = "gate"
    jump_filter: bool = True
