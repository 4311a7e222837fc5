"""Builds the map of the track from detections."""

import dataclasses as dc

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import LeafSystem

from airrace.immutable import Immutable
from airrace.systems import state_estimate as se
from airrace.systems.marker_statistics import MarkerStatistics, make_map
from airrace.systems.types import GateMap


@dc.dataclass(frozen=True, eq=False)
class _Memory(Immutable):
    """The mapper's state: the map and the statistics behind it."""

    statistics: dict
    gate_map: GateMap


class GateMapper(LeafSystem):
    """Averages the world positions of all sightings of each marker.

    .. pydrake_system::

        name: GateMapper
        input_ports:
        - detections
        - camera_info
        - state_estimate
        output_ports:
        - gate_map

    ``detections`` is a Detections, ``camera_info`` a CameraInfo,
    ``state_estimate`` see state_estimate.py; ``gate_map`` a GateMap.

    Detections are in the camera frame of an image of the past, so the mapper
    remembers the state estimates of the last moments and projects through
    the one at the image's own time.
    """

    def __init__(self, *, fps, latency, state_rate, max_range, max_gates,
                 outlier_sigma, min_sightings):
        """Constructs the mapper with an empty map.

        Args:
            fps: how often it looks for new detections (Hz).
            latency: from an image to its detections (s).
            state_rate: of the state estimate (Hz).
            max_range: sightings beyond this distance are ignored (m).
            max_gates: IDs of 4 max_gates and more are out of range.
            outlier_sigma: see MarkerStatistics.updated().
            min_sightings: before sightings can be outliers, and before a
                marker counts as known.
        """
        LeafSystem.__init__(self)
        self._max_range = max_range
        self._max_id = 4 * max_gates - 1
        self._outlier_sigma = outlier_sigma
        self._min_sightings = min_sightings
        self._detections = self.DeclareAbstractInputPort("detections", Value[object]())
        self._info = self.DeclareAbstractInputPort("camera_info", Value[object]())
        self._estimate = self.DeclareVectorInputPort("state_estimate", se.SIZE)
        # The last estimates, newest first, enough to reach back one latency.
        self._depth = int(np.ceil((latency + 1.0 / fps) * state_rate)) + 2
        history = np.zeros((self._depth, se.SIZE))
        history[:, 0] = -1.0
        self._history = self.DeclareDiscreteState(history.ravel())
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / state_rate, 0.0, self._Remember)
        self._memory = self.DeclareAbstractState(Value[object](_Memory({}, GateMap())))
        self.DeclarePeriodicUnrestrictedUpdateEvent(1.0 / fps, latency, self._UpdateMap)
        self.DeclareAbstractOutputPort(
            "gate_map",
            lambda: Value[object](GateMap()),
            self._CalcMap,
            {self.abstract_state_ticket(self._memory)},
        )

    def _Remember(self, context, discrete_state):
        estimate = self._estimate.Eval(context)
        history = context.get_discrete_state(self._history).value()
        if estimate[se.TIME] > history[0]:
            discrete_state.set_value(
                self._history, np.concatenate([estimate, history[:-se.SIZE]])
            )

    def _UpdateMap(self, context, state):
        detections = self._detections.Eval(context)
        memory = context.get_abstract_state(int(self._memory)).get_value()
        if not detections.markers or detections.time <= memory.gate_map.time:
            return
        X_WB = self._PoseAt(context, detections.time)
        if X_WB is None:
            return
        X_WC = X_WB @ self._info.Eval(context).X_BC
        statistics = dict(memory.statistics)
        out_of_range = memory.gate_map.out_of_range
        for marker in detections.markers:
            if marker.id > self._max_id:
                out_of_range += 1
            elif np.linalg.norm(marker.X_CM.translation()) <= self._max_range:
                statistics[marker.id] = self._Counted(statistics.get(marker.id), X_WC, marker)
        gate_map = make_map(
            statistics,
            min_sightings=self._min_sightings,
            time=detections.time,
            detections=memory.gate_map.detections + len(detections.markers),
            out_of_range=out_of_range,
        )
        state.get_mutable_abstract_state(int(self._memory)).set_value(
            _Memory(statistics, gate_map)
        )

    def _PoseAt(self, context, time) -> RigidTransform | None:
        """Returns X_WB at a time within the history, or None.

        The estimate before that time is carried forward with its velocities,
        which spares interpolating noise.
        """
        newest = self._estimate.Eval(context)
        history = context.get_discrete_state(self._history).value()
        for estimate in (newest, *history.reshape(self._depth, se.SIZE)):
            if 0.0 <= estimate[se.TIME] <= time + 1e-9:
                return extrapolate(estimate, time - estimate[se.TIME])
        return None

    def _Counted(self, statistics, X_WC, marker):
        X_WM = X_WC @ marker.X_CM
        if statistics is None:
            statistics = MarkerStatistics(0, 0, np.zeros(3), np.zeros(3), np.zeros(3))
        return statistics.updated(
            X_WM.translation(),
            X_WM.rotation().col(2),
            self._outlier_sigma,
            self._min_sightings,
        )

    def _CalcMap(self, context, output):
        output.set_value(context.get_abstract_state(int(self._memory)).get_value().gate_map)


def extrapolate(estimate, dt) -> RigidTransform:
    """Returns X_WB a short time after a state estimate.

    Args:
        estimate: vector of state_estimate.py, (14,).
        dt: (s).
    """
    q = estimate[se.QUATERNION]
    turn = dt * estimate[se.ANGULAR_VELOCITY]
    half = np.concatenate([[1.0], turn / 2])
    R_WB = RotationMatrix(Quaternion(half / np.linalg.norm(half))) @ RotationMatrix(
        Quaternion(q / np.linalg.norm(q))
    )
    return RigidTransform(R_WB, estimate[se.POSITION] + dt * estimate[se.VELOCITY])
