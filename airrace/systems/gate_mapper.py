"""Builds the map of the track from detections."""

import math

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import LeafSystem

from airrace.systems import state_estimate as se
from airrace.systems.detection_checks import JUMP
from airrace.systems.image_mapper import ImageMapper, MapperMemory
from airrace.systems.sighting import UNKNOWN_TIME
from airrace.systems.types import GateMap

# No flight leads so far from where the estimate before leads.
_LEAST_JUMP, _MOST_ACCELERATION = 0.2, 50.0  # m and rad; m/s^2 and rad/s^2
_REACH = 2.0  # periods of the estimate, beyond one it says nothing about the pose


class GateMapper(LeafSystem):
    """Makes one map of the sightings of all markers.

    .. pydrake_system::

        name: GateMapper
        input_ports:
        - detections
        - camera_info
        - filtered_estimate
        output_ports:
        - gate_map

    ``detections`` is a Detections, ``camera_info`` a CameraInfo,
    ``filtered_estimate`` see state_estimate.py; ``gate_map`` a GateMap.

    Detections are in the camera frame of an image of the past, so the mapper
    remembers the state estimates of the last moments and projects through
    the one at the image's own time. The filtered ones, as the noise of a single
    estimate would be most of the map's error.
    """

    def __init__(self, *, fps, latency, state_rate, **mapping):
        """Constructs the mapper with an empty map.

        Args:
            fps: how often it looks for new detections (Hz).
            latency: from an image to its detections (s).
            state_rate: of the state estimate (Hz).
            mapping: the arguments of ImageMapper.
        """
        LeafSystem.__init__(self)
        self._mapper = ImageMapper(**mapping)
        self._reach = _REACH / state_rate
        self._detections = self.DeclareAbstractInputPort("detections", Value[object]())
        self._info = self.DeclareAbstractInputPort("camera_info", Value[object]())
        self._estimate = self.DeclareVectorInputPort("filtered_estimate", se.SIZE)
        # The last estimates, newest first, enough to reach back one latency.
        self._depth = int(np.ceil((latency + 1.0 / fps) * state_rate)) + 2
        history = np.zeros((self._depth, se.SIZE))
        history[:, 0] = -1.0
        self._history = self.DeclareDiscreteState(history.ravel())
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / state_rate, 0.0, self._Remember)
        self._memory = self.DeclareAbstractState(Value[object](MapperMemory()))
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
        if _is_sound(estimate) and estimate[se.TIME] > history[0]:
            discrete_state.set_value(
                self._history, np.concatenate([estimate, history[:-se.SIZE]])
            )

    def _UpdateMap(self, context, state):
        detections = self._detections.Eval(context)
        memory = context.get_abstract_state(int(self._memory)).get_value()
        X_WB, reason = self._PoseAt(context, detections.time)
        info = self._info.Eval(context)
        X_WC = None if X_WB is None else X_WB @ info.X_BC
        after = self._mapper.updated(memory, detections, X_WC, info, reason)
        state.get_mutable_abstract_state(int(self._memory)).set_value(after)

    def _PoseAt(self, context, time) -> tuple[RigidTransform | None, str | None]:
        """Returns X_WB at a time within the history, or None and why there is none.

        The estimate before that time is carried forward with its velocities,
        which spares interpolating noise.
        """
        newest = self._estimate.Eval(context)
        history = context.get_discrete_state(self._history).value()
        history = history.reshape(self._depth, se.SIZE)
        if _is_sound(newest) and newest[se.TIME] > history[0, se.TIME]:
            history = np.vstack([newest, history])
        known = history[(history[:, se.TIME] >= 0.0) & (history[:, se.TIME] <= time + 1e-9)]
        if len(known) == 0 or not time - known[0, se.TIME] <= self._reach:
            return None, UNKNOWN_TIME
        if len(known) > 1 and _jumps(known[1], known[0]):
            return None, JUMP
        return extrapolate(known[0], time - known[0, se.TIME]), None

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


def _is_sound(estimate) -> bool:
    """Whether a state estimate is finite and its quaternion one."""
    numbers = estimate.tolist()
    return (
        all(map(math.isfinite, numbers)) and abs(math.hypot(*numbers[se.QUATERNION]) - 1.0) < 0.1
    )


def _jumps(before, after) -> bool:
    """Whether no flight leads from one state estimate to the next."""
    dt = after[se.TIME] - before[se.TIME]
    expected, actual = extrapolate(before, dt), extrapolate(after, 0.0)
    limit = _LEAST_JUMP + _MOST_ACCELERATION * dt**2
    turn = (expected.rotation().inverse() @ actual.rotation()).ToAngleAxis().angle()
    return bool(
        np.linalg.norm(expected.translation() - actual.translation()) > limit or turn > limit
    )
