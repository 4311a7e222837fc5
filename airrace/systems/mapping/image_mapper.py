"""From the detections of one image after another to a map, without Drake."""

import dataclasses as dc
from collections import Counter
from typing import Any

from pydrake.math import RigidTransform

from airrace.common.immutable import Immutable
from airrace.scenario import PerceptionConfig
from airrace.systems.mapping.observation import UNKNOWN_TIME, make_observation, refusal
from airrace.systems.mapping.original_estimator import OriginalEstimator
from airrace.systems.mapping.robust_estimator import RobustEstimator
from airrace.systems.perception.detection_checks import FOREIGN_ID
from airrace.systems.types import Detections
from airrace.track.gate_map import GateMap
from airrace.vehicle.camera_info import CameraInfo


@dc.dataclass(frozen=True, eq=False)
class MapperState(Immutable):
    """The mapper's state."""

    #: The estimator's state: GateTrack by gate number, or MarkerStatistics by marker ID.
    tracks: dict = dc.field(default_factory=dict)
    #: Dict of reasons to counts, without the estimator's own.
    refused: dict = dc.field(default_factory=dict)
    gate_map: GateMap = GateMap()  #: the map that follows from these
    image_time: float = -1.0  #: of the last image, whether it was of use or not (s)


class ImageMapper:
    """Maps image after image; what it knows is in a MapperState."""

    def __init__(self, config: PerceptionConfig):
        """Constructs the mapper.

        Args:
            config: of which estimator, outlier_sigma and min_observations say how it maps,
                and max_range and max_gates what it refuses.
        """
        self._max_range = config.max_range
        self._max_id = 4 * config.max_gates - 1
        self._estimator: Any = {
            "robust": lambda: RobustEstimator(min_observations=config.min_observations),
            "original": lambda: OriginalEstimator(
                outlier_sigma=config.outlier_sigma, min_observations=config.min_observations
            ),
        }[config.map_estimator]()

    def updated(
        self,
        state: MapperState,
        detections: Detections,
        X_WC: RigidTransform | None,
        info: CameraInfo,
        no_pose: str = UNKNOWN_TIME,
    ) -> MapperState:
        """Returns the state after one more image; an old one changes nothing.

        Args:
            state: before.
            detections: of the image.
            X_WC: pose of the camera when it was taken, None if unknown.
            info: the camera's calibration.
            no_pose: why the pose is unknown.
        """
        before = state.gate_map
        if detections.time <= before.time or detections.time == state.image_time:
            return state
        if not detections.markers and not detections.refused:
            return state
        tracks, refused = state.tracks, Counter(state.refused)
        refused.update(reason for reason, _ in detections.refused)
        for marker in detections.markers:
            reason = refusal(marker, self._max_id, self._max_range)
            if reason is None and X_WC is None:
                reason = no_pose
            if reason is None:
                observation = make_observation(marker, X_WC, info, detections.time)
                tracks = self._estimator.updated(tracks, observation)
            else:
                refused[reason] += 1
        foreign = sum(reason == FOREIGN_ID for reason, _ in detections.refused)
        gate_map = self._estimator.make_map(
            tracks,
            # Without a pose, the image's time may be wrong as well.
            time=before.time if X_WC is None else detections.time,
            detections=before.detections + len(detections.markers) + foreign,
            out_of_range=refused[FOREIGN_ID],
            refused=+refused,
        )
        return MapperState(tracks, dict(refused), gate_map, detections.time)
