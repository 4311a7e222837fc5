"""From the detections of one image after another to a map: pure functions."""

import dataclasses as dc
from collections import Counter

from pydrake.math import RigidTransform

from airrace.common.immutable import Immutable
from airrace.systems.mapping.gate_estimator import RobustEstimator
from airrace.systems.mapping.marker_statistics import ReportEstimator
from airrace.systems.mapping.observation import UNKNOWN_TIME, make_observation, refusal
from airrace.systems.perception.detection_checks import FOREIGN_ID
from airrace.systems.types import CameraInfo, Detections
from airrace.track.gate_map import GateMap


@dc.dataclass(frozen=True, eq=False)
class MapperMemory(Immutable):
    """The mapper's state.

    Attributes:
        records: what the estimator remembers.
        refused: dict of reasons to counts, without the estimator's own.
        gate_map: the map that all this amounts to.
        image_time: of the last image looked at, of use or not (s).
    """

    records: dict = dc.field(default_factory=dict)
    refused: dict = dc.field(default_factory=dict)
    gate_map: GateMap = GateMap()
    image_time: float = -1.0


class ImageMapper:
    """Maps image after image; what it knows is in a MapperMemory."""

    def __init__(self, *, max_range, max_gates, estimator, outlier_sigma, min_observations):
        """Constructs the mapper.

        Args:
            max_range: observations beyond this distance are refused (m).
            max_gates: IDs of 4 max_gates and more are out of range.
            estimator: "robust" or "report".
            outlier_sigma: of the report's estimator, see MarkerStatistics.
            min_observations: before the report's estimator takes an observation for an
                outlier, and of both pylons before a gate is in the map.
        """
        self._max_range = max_range
        self._max_id = 4 * max_gates - 1
        self._estimator = {
            "robust": lambda: RobustEstimator(min_observations=min_observations),
            "report": lambda: ReportEstimator(
                outlier_sigma=outlier_sigma, min_observations=min_observations
            ),
        }[estimator]()

    def updated(
        self,
        memory: MapperMemory,
        detections: Detections,
        X_WC: RigidTransform | None,
        info: CameraInfo,
        no_pose: str = UNKNOWN_TIME,
    ) -> MapperMemory:
        """Returns the memory after one more image; an old one changes nothing.

        Args:
            memory: before.
            detections: of the image.
            X_WC: pose of the camera when it was taken, None if unknown.
            info: the camera's calibration.
            no_pose: why the pose is unknown.
        """
        if detections.time <= memory.gate_map.time or detections.time == memory.image_time:
            return memory
        if not detections.markers and not detections.refused:
            return memory
        records = memory.records
        refused = Counter(memory.refused)
        refused.update(reason for reason, _ in detections.refused)
        for marker in detections.markers:
            reason = refusal(marker, self._max_id, self._max_range)
            if reason is None and X_WC is None:
                reason = no_pose
            if reason is None:
                observation = make_observation(marker, X_WC, info, detections.time)
                records = self._estimator.updated(records, observation)
            else:
                refused[reason] += 1
        foreign = [id for reason, id in detections.refused if reason == FOREIGN_ID]
        before = memory.gate_map
        gate_map = self._estimator.make_map(
            records,
            # An image of unknown pose may be of an impossible time.
            time=before.time if X_WC is None else detections.time,
            detections=before.detections + len(detections.markers) + len(foreign),
            out_of_range=refused[FOREIGN_ID],
            refused=+refused,
        )
        return MapperMemory(records, dict(refused), gate_map, detections.time)
