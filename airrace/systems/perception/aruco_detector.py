"""Finds marker boards in the camera's image."""

import dataclasses as dc
import math
from typing import Self

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import ValueProducer

from airrace.common.immutable import Immutable
from airrace.scenario import Scenario
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.perception import detection_checks as checks
from airrace.systems.perception.marker_measurement import DetectorConfig, measure
from airrace.systems.perception.marker_search import MarkerSearch
from airrace.systems.sensing.camera_view import CameraView
from airrace.systems.types import Detections
from airrace.vehicle.camera_info import CameraInfo

_LONGEST_GAP = 0.1  # s, between images, over which motion can be predicted
_AT_REST = np.zeros(2)  # px/s
_EMPTY_PERIOD = 5  # images, of full searches while no marker is found


@dc.dataclass(frozen=True, eq=False)
class DetectorState(Immutable):
    """What the detector keeps of one image for the next."""

    detections: Detections = Detections()  #: the result
    #: Tuple of Detection, with those whose pose jumped: if they stay there, the pose before was the
    #: wrong one.
    measured: tuple = ()
    #: Of the centres of the markers, ID to (2,) px/s.
    velocities: dict = dc.field(default_factory=dict)
    age: float = math.inf  #: number of images since the last full search
    period: int = 0  #: number of images from that search to the next


class ArucoDetector(LeafSystem):
    """Detects ArUco markers and their poses in the camera frame.

    .. pydrake_system::

        name: ArucoDetector
        input_ports:
        - camera_view
        - camera_image_time
        - camera_info
        output_ports:
        - detections

    ``camera_view`` is a CameraView, ``camera_image_time`` when it was
    taken (s), ``camera_info`` a CameraInfo; ``detections`` a Detections.

    detect() is what it computes: search (marker_search.py), refit of the corners
    (corner_refit.py), checks (detection_checks.py) and poses (marker_pose.py). By its
    settings, see DetectorConfig, corners and poses are OpenCV's own.

    The output is a function of the inputs and of the last image's markers, which are
    the state. A full search covers the whole image. In the images between two full
    searches, only regions around the predicted markers are searched. If a marker is not
    found there, it left the image, or is too blurred or small for a full search as well.
    Full searches become rarer while the same markers are in the images, and frequent
    again when one appears or disappears, because then others may appear, too.
    An image is searched once, however often the output is evaluated.
    """

    def __init__(self, *, fps: float = 30.0, config: DetectorConfig = DetectorConfig()):
        """Args: fps: rate of the camera, at which the state is updated (Hz). config: settings."""
        LeafSystem.__init__(self)
        self._search = MarkerSearch(refine=config.corners == "opencv")
        self._config = config
        self._view = self.DeclareAbstractInputPort("camera_view", Value[object]())
        self._time = self.DeclareVectorInputPort("camera_image_time", 1)
        self._info = self.DeclareAbstractInputPort("camera_info", Value[object]())
        self._state = self.DeclareAbstractState(Value[object](DetectorState()))
        entry = self.DeclareCacheEntry(
            "result",
            ValueProducer(
                allocate=lambda: Value[object](DetectorState()), calc=self.held(self._calc_result)
            ),
            {port.ticket() for port in (self._view, self._time, self._info)}
            | {self.abstract_state_ticket(self._state)},
        )
        self._result = entry.cache_index()  # an entry would hold the system that holds it
        # An unrestricted update comes before the camera takes the next image at
        # the same time.
        self.DeclarePeriodicUnrestrictedUpdateEvent(1.0 / fps, 0.0, self._update_state)
        self.DeclareAbstractOutputPort(
            "detections",
            lambda: Value[object](Detections()),
            lambda context, output: output.set_value(self._recall(context).detections),
            {entry.ticket()},
        )

    @classmethod
    def from_scenario(cls, scenario: Scenario) -> Self:
        """Returns the detector of a scenario."""
        perception = scenario.perception
        config = DetectorConfig(
            corners=perception.corners, poses=perception.poses, jump_filter=perception.jump_filter
        )
        return cls(fps=scenario.camera.fps, config=config)

    def _recall(self, context):
        return self.get_cache_entry(self._result).Eval(context)

    def _calc_result(self, context, result):
        last = context.get_abstract_state(int(self._state)).get_value()
        time = float(self._time.Eval(context)[0])
        if time == last.detections.time:
            result.set_value(last)
            return
        result.set_value(
            detect(
                self._search,
                self._view.Eval(context),
                time,
                self._info.Eval(context),
                last,
                self._config,
            )
        )

    def _update_state(self, context, state):
        state.get_mutable_abstract_state(int(self._state)).set_value(self._recall(context))


def detect(
    search: MarkerSearch,
    view: CameraView,
    time: float,
    info: CameraInfo,
    last: DetectorState,
    config: DetectorConfig = DetectorConfig(),
) -> DetectorState:
    """Detects the markers in an image.

    Args:
        search: finds the markers, and refines their corners if config.corners is "opencv".
        view: of the image.
        time: when it was taken (s).
        info: the camera.
        last: of the last image; DetectorState() if there was none.
        config: settings.
    """
    if reason := checks.check_view(view, time, info):
        return DetectorState(Detections(time, (), ((reason, None),)))
    dt = time - last.detections.time
    if last.age + 1 < last.period and 0 < dt < _LONGEST_GAP:
        predictions = {
            m.id: m.corners + dt * last.velocities.get(m.id, _AT_REST) for m in last.measured
        }
        (ids, quads), age = search.around(view, predictions), last.age + 1
    else:
        (ids, quads), age = search.everywhere(view.whole()), 0
    measured, refused = measure(view, ids, quads, info, config)

    before = {m.id: m for m in last.measured}
    pairs = [(m, before[m.id]) for m in measured if m.id in before]
    jumped = {m.id for m, old in pairs if config.jump_filter and checks.jumps(m, old, dt)}
    detections = Detections(
        time,
        tuple(m for m in measured if m.id not in jumped),
        (*refused, *((checks.JUMP, id) for id in sorted(jumped))),
    )
    velocities = {m.id: (m.corners - old.corners).sum(axis=0) / (4 * dt) for m, old in pairs}

    shortest, longest = config.full_search_periods
    if not measured:
        period = min(shortest, _EMPTY_PERIOD)
    elif before.keys() != {m.id for m in measured}:
        period = shortest
    else:
        period = last.period if age else min(2 * last.period, longest)
    return DetectorState(detections, measured, velocities, age, period)
