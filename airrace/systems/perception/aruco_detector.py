"""Finds marker boards in the camera's image."""

import dataclasses as dc
import math

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import LeafSystem, ValueProducer

from airrace.common.immutable import Immutable
from airrace.systems.perception import detection_checks as checks
from airrace.systems.perception.marker_measurement import measure
from airrace.systems.perception.marker_search import MarkerSearch
from airrace.systems.sensing.camera_view import CameraView
from airrace.systems.types import CameraInfo, Detections

_LONGEST_GAP = 0.1  # s, between images, over which motion can be predicted
_AT_REST = np.zeros(2)  # px/s
_EMPTY_PERIOD = 5  # images, of which all of one is searched while no marker is in sight
PERIODS = 8, 16  # images, of which all of one is searched otherwise; see ArucoDetector


@dc.dataclass(frozen=True, eq=False)
class Sight(Immutable):
    """What the detector remembers of one image.

    Attributes:
        detections: what it made of it.
        measured: tuple of Detection, with those whose pose jumped: if they stay
            there, it was the one before that was wrong.
        velocities: of the centres of the markers, ID to (2,) px/s.
        tracked: number of images since all of one was searched.
        period: all of the image that is so many after that one will be searched.
    """

    detections: Detections = Detections()
    measured: tuple = ()
    velocities: dict = dc.field(default_factory=dict)
    tracked: float = math.inf
    period: int = 0


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

    The output is a function of the inputs and of what was in the last image,
    which is the state: all of an image is searched every few frames, sooner
    while no marker is in sight, and less often while none comes or goes. In
    between, only the regions around the markers that were in the last one are
    searched. One that is lost there has left, or is too blurred or small: a search
    of all of the image does not find it either. But who passes a gate will see
    the next, so then all is searched sooner again.
    Drake's cache makes sure that an image is searched once, however many look
    at the detections.
    """

    def __init__(self, *, fps=30.0, max_gates=None, full_search_periods=PERIODS):
        """Constructs the detector.

        Args:
            fps: how often it remembers what it has seen (Hz): the camera's.
            max_gates: IDs of 4 max_gates and more are refused; None for no limit.
            full_search_periods: all of every so many images is searched: at first,
                and at last, if nothing comes or goes; (1, 1) for all of every image.
        """
        LeafSystem.__init__(self)
        self._search = MarkerSearch()
        self._max_id = np.inf if max_gates is None else 4 * max_gates - 1
        self._periods = full_search_periods
        self._view = self.DeclareAbstractInputPort("camera_view", Value[object]())
        self._time = self.DeclareVectorInputPort("camera_image_time", 1)
        self._info = self.DeclareAbstractInputPort("camera_info", Value[object]())
        self._memory = self.DeclareAbstractState(Value[object](Sight()))
        self._sight = self.DeclareCacheEntry(
            "sight",
            ValueProducer(allocate=lambda: Value[object](Sight()), calc=self._calc_sight),
            {port.ticket() for port in (self._view, self._time, self._info)}
            | {self.abstract_state_ticket(self._memory)},
        )
        # An unrestricted update comes before the camera takes the next image at
        # the same time.
        self.DeclarePeriodicUnrestrictedUpdateEvent(1.0 / fps, 0.0, self._remember)
        self.DeclareAbstractOutputPort(
            "detections",
            lambda: Value[object](Detections()),
            lambda context, output: output.set_value(self._sight.Eval(context).detections),
            {self._sight.ticket()},
        )

    def _calc_sight(self, context, sight):
        last = context.get_abstract_state(int(self._memory)).get_value()
        time = float(self._time.Eval(context)[0])
        if time == last.detections.time:
            sight.set_value(last)
            return
        sight.set_value(
            look(
                self._search,
                self._view.Eval(context),
                time,
                self._info.Eval(context),
                last,
                max_id=self._max_id,
                full_search_periods=self._periods,
            )
        )

    def _remember(self, context, state):
        state.get_mutable_abstract_state(int(self._memory)).set_value(self._sight.Eval(context))


def look(
    search: MarkerSearch,
    view: CameraView,
    time,
    info: CameraInfo,
    last: Sight,
    *,
    max_id=np.inf,
    full_search_periods=PERIODS,
) -> Sight:
    """Returns what is in an image, given what was in the last one.

    Args:
        search: finds the markers.
        view: of the image.
        time: when it was taken (s).
        info: the camera.
        last: of the last image; Sight() if there was none.
        max_id, full_search_periods: see ArucoDetector.
    """
    if reason := checks.check_view(view, time, info):
        return Sight(Detections(time, (), ((reason, None),)))
    dt = time - last.detections.time
    least, most = full_search_periods
    if last.tracked + 1 < last.period and 0 < dt < _LONGEST_GAP:
        predictions = {
            m.id: m.corners + dt * last.velocities.get(m.id, _AT_REST) for m in last.measured
        }
        found, tracked = search.around(view, predictions), last.tracked + 1
    else:
        found, tracked = search.everywhere(view.whole()), 0
    measured, refused = measure(view, *found, info, max_id)
    before = {marker.id: marker for marker in last.measured}
    period = last.period if tracked else min(2 * last.period, most)
    if before.keys() != {m.id for m in measured}:
        period = least
    if not measured:
        period = min(least, _EMPTY_PERIOD)
    jumping = {m.id for m in measured if m.id in before and checks.jumps(m, before[m.id], dt)}
    detections = Detections(
        time,
        tuple(m for m in measured if m.id not in jumping),
        (*refused, *((checks.JUMP, id) for id in sorted(jumping))),
    )
    velocities = {
        m.id: (m.corners - before[m.id].corners).sum(axis=0) / (4 * dt)
        for m in measured
        if m.id in before
    }
    return Sight(detections, measured, velocities, tracked, period)
