"""A message of every type of the link, and the value that it carries."""

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.trajectories import PiecewisePolynomial

from airrace import lcmtypes
from airrace.hitl.channels import make_channels
from airrace.hitl.link.packets import Stamp, pack
from airrace.scenario import Scenario
from airrace.systems.planning.lap_plan import LapPlan, PlanSummary
from airrace.systems.sensing.camera_view import CameraView
from airrace.systems.types import (
    ExplorerEvent,
    ExplorerStatus,
    GateCrossing,
    PolicyStatus,
    RefereeStatus,
)
from airrace.track.gate_map import GateEstimate, GateMap, MarkerEstimate
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.min_snap.circuit import Circuit
from airrace.vehicle.camera_info import make_camera_info

STAMP = Stamp(session=7, sequence=3, time=1 / 3)
_noise = np.random.Generator(np.random.PCG64(1))


def scenario(policy="none"):
    """A small camera, so that pictures are quick."""
    result = Scenario(policy=policy)
    result.camera.width, result.camera.height = 96, 64
    return result


def polynomial(segments=3):
    breaks = np.concatenate([[0.0], np.cumsum(_noise.uniform(0.3, 2.0, segments))])
    return PiecewisePolynomial.CubicShapePreserving(
        breaks, _noise.normal(size=(4, segments + 1)), zero_end_point_derivatives=True
    )


def lap_plan():
    lap = polynomial(6)
    circuit = Circuit(lap, [0.0, 1.0, lap.end_time()], (0.1, 1 / 3), {1: 2.5})
    return LapPlan(
        2,
        1 / 7,
        FlatTrajectory(polynomial()),
        circuit,
        0.25,
        PlanSummary(
            0.5,
            lap.end_time(),
            19.0,
            9.5,
            4.5,
            (4.5, 3.0),
            (0.5, 1.0),
            6.0,
            None,
            0.3,
            ("speed",),
            17.5,
            "Clarabel",
            3,
            True,
            (0.97, 1.02),
            (0.1, 0.006),
            (3.0, -0.5, 0.0),
        ),
    )


def values():
    """Returns a dict of the values of all ports of the link."""
    picture = _noise.integers(0, 256, (64, 96), np.uint8)
    estimate = np.array([1 / 3, 1.0, 0.0, 0.0, 0.0, *_noise.normal(size=9)])
    markers = tuple(MarkerEstimate(i, 5 * i, i, *_noise.normal(size=(3, 3))) for i in range(4))
    gates = (GateEstimate(0, _noise.normal(size=3), 0.1, 10.0),)
    events = (ExplorerEvent(0.0, "CALIBRATE", "power on"), ExplorerEvent(1 / 3, "DONE", "über"))
    crossings = (GateCrossing(1 / 3, 1, 1, 0.1, 12.5), GateCrossing(2 / 3, 2, 1, 0.2, 13.5))
    rotors = _noise.uniform(0, 90, 8)
    return {
        "camera_image_time": np.array([1 / 3]),
        "camera_view": CameraView.of(picture),
        "camera_info": make_camera_info(
            width=96,
            height=64,
            fov_y=1.0,
            D=(0.1, 0.2, 0.3, 0.4, 0.5),
            X_BC=RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [1.0, 2.0, 3.0]),
        ),
        "state_estimate": estimate,
        "imu": np.column_stack(
            [1 / 3 - 0.002 * np.arange(10), _noise.normal(size=(10, 6))]
        ).ravel(),
        "rotor_speeds": rotors[:4],
        "rotor_status": np.array([1 / 3, *rotors]),
        "rotor_speed_command": _noise.uniform(0, 90, 4),
        "rotor_losses": np.array([np.inf, 2.5, np.inf, np.inf]),
        "explorer_status": ExplorerStatus("DONE", "über", 1 / 3, (2, 0, 1), 1 / 7, True, events),
        "policy_status": PolicyStatus(False, 1 / 3, "it missed a gate", True, 7),
        "gate_map": GateMap(1 / 3, markers, gates, 20, 1, {"stray": 3, "far": 2}),
        "lap_plan": lap_plan(),
        "truth.referee_status": RefereeStatus(crossings, False, "hit the ground", 2.5, 1),
    }


ROWS = make_channels(scenario(policy="learned"), ("camera_view", "state_estimate", "imu"))


def message_of(row, given=None):
    """Returns the message of a row of the table, with some values."""
    given = given or values()
    return row.encode(lossless=True, **{port: given[port] for port in row.ports})


def packed():
    """Returns channel to (bytes, message type, decode) of all types, the heartbeat included."""
    result = {
        row.name: (pack(message_of(row), STAMP), row.message_type, row.decode) for row in ROWS
    }
    for kind in (lcmtypes.lcmt_heartbeat, lcmtypes.lcmt_link_status):
        result[kind.__name__] = (pack(kind(), STAMP), kind, lambda message: message)
    return result
