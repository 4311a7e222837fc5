"""Builds the map of the track from detections."""

from typing import Self

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context

from airrace.scenario import PerceptionConfig, Scenario
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.mapping.image_mapper import ImageMapper, MapperState
from airrace.systems.mapping.observation import UNKNOWN_TIME
from airrace.systems.perception.detection_checks import JUMP
from airrace.systems.ports import read_vector
from airrace.systems.sensing.pose_history import jumps, last_two, moved, remember
from airrace.track.gate_map import GateMap
from airrace.vehicle.state import STATE_SIZE, as_state

_LONGEST_GAP = 2.0  # periods of the estimate: an older one says nothing about the pose


class GateMapper(LeafSystem):
    """Estimates where the gates stand, from the observations of all markers.

    .. pydrake_system::

        name: GateMapper
        input_ports:
        - detections
        - camera_info
        - filtered_estimate
        output_ports:
        - gate_map

    ``detections`` is a Detections, ``camera_info`` a CameraInfo,
    ``filtered_estimate`` see vehicle/state.py; ``gate_map`` a GateMap.

    Detections belong to an image of the past, so the mapper keeps a history of state
    estimates and uses the pose at the image's own time. The estimates are filtered ones,
    because the noise of a single one would be most of the map's error.
    """

    def __init__(
        self,
        *,
        fps: float,
        latency: float,
        state_rate: float,
        link_delay: float = 0.0,
        config: PerceptionConfig,
    ):
        """Constructs the mapper with an empty map.

        Args:
            fps: how often it reads new detections (Hz).
            latency: from an image to its detections (s).
            state_rate: of the state estimate (Hz).
            link_delay: additional delay of detections (s).
            config: see ImageMapper; and by its jump_filter, images that were taken where
                the state estimate jumps are refused.
        """
        LeafSystem.__init__(self)
        self._mapper = ImageMapper(config)
        self._longest_gap = _LONGEST_GAP / state_rate
        self._jump_filter = config.jump_filter
        self._detections = self.DeclareAbstractInputPort("detections", Value[object]())
        self._info = self.DeclareAbstractInputPort("camera_info", Value[object]())
        self._estimate = self.DeclareVectorInputPort("filtered_estimate", STATE_SIZE)
        # The last estimates, newest first, enough to reach back one latency.
        self._depth = int(np.ceil((latency + link_delay + 1.0 / fps) * state_rate)) + 2
        history = np.zeros((self._depth, STATE_SIZE))
        history[:, 0] = -1.0
        self._history = self.DeclareDiscreteState(history.ravel())
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / state_rate, 0.0, self._update_history)
        self._state = self.DeclareAbstractState(Value[object](MapperState()))
        self.DeclarePeriodicUnrestrictedUpdateEvent(1.0 / fps, latency, self._update_map)
        self.DeclareAbstractOutputPort(
            "gate_map",
            lambda: Value[object](GateMap()),
            self._calc_map,
            {self.abstract_state_ticket(self._state)},
        )

    @classmethod
    def from_scenario(cls, scenario: Scenario) -> Self:
        """Returns the mapper of a scenario."""
        return cls(
            fps=scenario.camera.fps,
            # The mapper counts from the exposure.
            latency=scenario.perception.latency + scenario.camera.resolved().latency,
            state_rate=scenario.state_estimate.rate,
            link_delay=scenario.link_delay,
            config=scenario.perception,
        )

    def _update_history(self, context, discrete_state):
        remember(
            discrete_state.get_mutable_value(self._history), read_vector(self._estimate, context)
        )

    def _update_map(self, context, state):
        detections = self._detections.Eval(context)
        before = context.get_abstract_state(int(self._state)).get_value()
        X_WB, reason = self._pose_at(context, detections.time)
        info = self._info.Eval(context)
        X_WC = None if X_WB is None else X_WB @ info.X_BC
        after = self._mapper.updated(before, detections, X_WC, info, reason)
        state.get_mutable_abstract_state(int(self._state)).set_value(after)

    def _pose_at(self, context: Context, time: float) -> tuple[RigidTransform | None, str | None]:
        """Returns X_WB at a time within the history, or None and why there is none.

        The estimate before that time is extrapolated with its velocities; the difference
        of two estimates would be noise.
        """
        history = context.get_discrete_state(self._history).value()
        last, before = last_two(history, self._estimate.Eval(context), time)
        last_time = as_state(last).time
        if last_time < 0.0 or not time - last_time <= self._longest_gap:
            return None, UNKNOWN_TIME
        if self._jump_filter and as_state(before).time >= 0.0 and jumps(before, last):
            return None, JUMP
        return extrapolate(last, time - last_time), None

    def _calc_map(self, context, output):
        output.set_value(context.get_abstract_state(int(self._state)).get_value().gate_map)


def extrapolate(estimate: np.ndarray, dt: float) -> RigidTransform:
    """Returns X_WB a short time after a state estimate.

    Args: estimate: vector of vehicle/state.py, (14,). dt: (s).
    """
    quaternion, p_WB = moved(estimate, dt)
    return RigidTransform(Quaternion(quaternion), p_WB)
