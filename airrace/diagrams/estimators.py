"""Makes the two systems that tell the drone where it is, if nobody else does."""

import math
from typing import TYPE_CHECKING

import numpy as np
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from airrace.systems.estimation.error_state import ImuNoise
from airrace.systems.estimation.gate_slam import GateSlam
from airrace.systems.estimation.slam_filter import MapFrame
from airrace.systems.estimation.strapdown_integrator import StrapdownIntegrator, history_depth
from airrace.systems.plant.multirotor import AddMultirotorModel, ground_clearance
from airrace.track import Start, load_track, start_pose
from airrace.vehicle import GRAVITY, Vehicle, load_vehicle
from airrace.vehicle.state import STATE_SIZE, as_state

if TYPE_CHECKING:
    from pathlib import Path

    from airrace.scenario import Scenario

_SIGMAS = 2.5  # of the accelerometer's bias: a greater tilt is the pad's


def make_gate_slam(scenario: "Scenario") -> GateSlam:
    """Returns the GateSlam of a scenario."""
    vehicle, sdf = load_vehicle(scenario.drone)
    errors = scenario.imu.resolved()
    return GateSlam(
        fps=scenario.camera.fps,
        latency=_latency(scenario),
        link_delay=scenario.link_delay,
        imu_rate=scenario.imu.rate,
        frame=MapFrame(
            math.radians(load_track(scenario.track).start.heading_deg),
            _PadPosition(scenario, vehicle, _standing_height(vehicle, sdf)),
        ),
        noise=ImuNoise(
            gyro=errors.gyro_noise,
            accel=errors.accelerometer_noise,
            gyro_walk=errors.gyro_walk,
            accel_walk=errors.accelerometer_walk,
            accel_turn_on=errors.accelerometer_bias,
            period=1.0 / scenario.imu.rate,
        ),
        vehicle=vehicle,
        config=scenario.perception,
    )


def make_strapdown_integrator(scenario: "Scenario") -> StrapdownIntegrator:
    """Returns the StrapdownIntegrator of a scenario."""
    vehicle, sdf = load_vehicle(scenario.drone)
    errors = scenario.imu.resolved()
    start = load_track(scenario.track).start
    X_WB = start_pose(
        Start(start.position, start.heading_deg), vehicle.radius, _standing_height(vehicle, sdf)
    )
    at_rest = np.zeros(STATE_SIZE)
    as_state(at_rest).quaternion[:] = X_WB.rotation().ToQuaternion().wxyz()
    as_state(at_rest).position[:] = X_WB.translation()
    return StrapdownIntegrator(
        vehicle=vehicle,
        rate=scenario.imu.rate,
        depth=history_depth(
            scenario.camera.fps, _latency(scenario) + scenario.link_delay, scenario.imu.rate
        ),
        start=at_rest,
        ranges=np.repeat([errors.gyro_range, errors.accelerometer_range], 3),
        link_delay=scenario.link_delay,
    )


def _latency(scenario: "Scenario") -> float:
    """Returns the time from an exposure to its detections (s)."""
    return scenario.perception.latency + scenario.camera.resolved().latency


class _PadPosition:
    """Where the inertial sensor of a drone on its pad is.

    The pad's centre is the one point of the track that the drone knows: it defines the frame of
    its map. How the pad is tilted, the drone's own tilt says; unless that may be an error of its
    accelerometer, and the pad is level.
    """

    def __init__(self, scenario: "Scenario", vehicle: Vehicle, standing_height: float):
        self._start = load_track(scenario.track).start
        self._least_tilt = _SIGMAS * scenario.imu.resolved().accelerometer_bias / GRAVITY
        self._radius, self._height = vehicle.radius, standing_height
        self._p_BI = np.array(vehicle.imu.position, float)

    def __call__(self, R_WB: np.ndarray) -> np.ndarray:
        """Returns p_WI (m), (3,). Args: R_WB: of the drone at rest, (3, 3)."""
        x, y, z = R_WB[:, 2]
        tilt = math.atan2(math.hypot(x, y), z)
        pad = Start(
            self._start.position,
            self._start.heading_deg,
            pad_tilt_deg=math.degrees(tilt) if tilt > self._least_tilt else 0.0,
            pad_tilt_direction_deg=math.degrees(math.atan2(y, x)),
        )
        return start_pose(pad, self._radius, self._height).translation() + R_WB @ self._p_BI


def _standing_height(vehicle: Vehicle, sdf: "Path") -> float:
    """Returns how high the drone's origin is above what it stands on (m)."""
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.001)
    return ground_clearance(AddMultirotorModel(plant, vehicle, sdf), scene_graph)
