"""Corrects the drone's motion at every picture, and maps the gates."""

import dataclasses as dc

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, EventStatus

from airrace.scenario import PerceptionConfig
from airrace.systems.estimation.error_state import ImuNoise
from airrace.systems.estimation.lost_estimate import drift_sigma, why_lost
from airrace.systems.estimation.navigation import NAVIGATION_SIZE
from airrace.systems.estimation.slam_filter import MapFrame, SlamFilter
from airrace.systems.estimation.slam_state import SlamState, map_of
from airrace.systems.estimation.strapdown_integrator import history_depth
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_vector
from airrace.systems.sensing.imu_samples import SAMPLE_SIZE
from airrace.track.gate_map import GateMap
from airrace.vehicle import GRAVITY, Vehicle

_TURNING = 0.3  # of the weight: they idle with less, and with more the drone may move


class GateSlam(LeafSystem):
    """Estimates where drone and gates are from pictures of markers and inertial samples.

    .. pydrake_system::

        name: GateSlam
        input_ports:
        - detections
        - camera_info
        - imu_history
        - imu_silence
        - rotor_speeds
        output_ports:
        - corrections
        - gate_map
        - estimate_fault
        - slam_state
        - estimate_drift

    ``detections`` is a Detections, ``camera_info`` a CameraInfo, ``imu_history`` and
    ``imu_silence`` (s) see StrapdownIntegrator, ``rotor_speeds`` as measured (rad/s).
    ``corrections`` (17) is the Navigation at the exposure of the newest picture, from which a
    StrapdownIntegrator goes on; ``gate_map`` a GateMap; ``estimate_fault`` says in words why the
    drone cannot go by its estimate any more, and is empty while it can; ``estimate_drift`` is
    drift_sigma() (m); ``slam_state`` a SlamState, for who wants to know how certain it is.

    Detections belong to a picture of the past. The filter stands at the exposure of the newest
    one; samples that are newer wait in the StrapdownIntegrator's history for the next. Without a
    new picture the filter follows at the same distance, so that no sample is lost to it. Once there
    is a fault, the filter takes up nothing more: a jump of the estimate would not help a landing.
    """

    def __init__(
        self,
        *,
        fps: float,
        latency: float,
        link_delay: float = 0.0,
        imu_rate: float,
        frame: MapFrame,
        noise: ImuNoise,
        vehicle: Vehicle,
        config: PerceptionConfig,
    ):
        """Constructs the filter; the map is empty.

        Args:
            fps: of the camera (Hz).
            latency: from an exposure to its detections (s).
            link_delay: additional delay of detections and samples (s).
            imu_rate: of the inertial sensor (Hz).
            frame: of the map.
            noise: of the inertial sensor.
            vehicle: its rotors, mass and where the sensor is.
            config: see SlamFilter.
        """
        LeafSystem.__init__(self)
        self._filter = SlamFilter(
            frame=frame, noise=noise, p_BI=np.array(vehicle.imu.position), config=config
        )
        self._link_delay = link_delay
        self._longest_wait = latency + link_delay + 1.5 / fps
        self._thrust_coefficients = np.array(vehicle.thrust_coefficients)
        self._idle = _TURNING * vehicle.mass * GRAVITY
        depth = history_depth(fps, latency + link_delay, imu_rate)
        self._detections = self.DeclareAbstractInputPort("detections", Value[object]())
        self._info = self.DeclareAbstractInputPort("camera_info", Value[object]())
        self._history = self.DeclareVectorInputPort("imu_history", SAMPLE_SIZE * depth)
        self._silence = self.DeclareVectorInputPort("imu_silence", 1)
        self._speeds = self.DeclareVectorInputPort("rotor_speeds", len(vehicle.rotors))
        self._state = self.DeclareAbstractState(Value[object](SlamState()))
        self.DeclarePeriodicUnrestrictedUpdateEvent(1.0 / fps, latency, self._update)
        ticket = {self.abstract_state_ticket(self._state)}
        self.DeclareVectorOutputPort(
            "corrections",
            NAVIGATION_SIZE,
            lambda context, output: output.set_value(self._recall(context).belief.navigation),
            ticket,
        )
        for name, nothing, part in (
            ("gate_map", GateMap(), map_of),
            ("estimate_fault", "", lambda state: state.fault),
            ("slam_state", SlamState(), lambda state: state),
        ):
            self.DeclareAbstractOutputPort(
                name,
                lambda nothing=nothing: Value[object](nothing),
                lambda context, output, part=part: output.set_value(part(self._recall(context))),
                ticket,
            )
        self.DeclareVectorOutputPort(
            "estimate_drift",
            1,
            lambda context, output: output.SetAtIndex(0, drift_sigma(self._recall(context).belief)),
            ticket,
        )

    def _recall(self, context: Context) -> SlamState:
        return context.get_abstract_state(int(self._state)).get_value()

    def _rotors_turn(self, context):
        """Whether they give more thrust than at rest; a rotor without a speed gives none."""
        speeds = read_vector(self._speeds, context)
        speeds = np.where(np.isfinite(speeds), speeds, 0.0)
        return bool(self._thrust_coefficients @ speeds**2 > self._idle)

    def _update(self, context, state):
        before, detections = self._recall(context), self._detections.Eval(context)
        oldest = context.get_time() - self._longest_wait
        is_new = detections.time > max(before.image_time, before.time, oldest)
        time = detections.time if is_new else oldest
        if time <= before.time or before.fault:
            return EventStatus.DidNothing()
        history = read_vector(self._history, context).reshape(-1, SAMPLE_SIZE)
        turn = not before.at_rest or self._rotors_turn(context)
        after = self._filter.propagated(before, np.array(history), time, turn)
        if is_new:
            after = self._filter.updated(after, detections, self._info.Eval(context))
        fault = why_lost(after, float(self._silence.Eval(context)[0]) - self._link_delay)
        if fault:
            after = dc.replace(before, fault=fault)
        state.get_mutable_abstract_state(int(self._state)).set_value(after)
        return EventStatus.Succeeded()
