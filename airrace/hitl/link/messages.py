"""From the values on ports to messages, and back: one pair of functions a type, no logic.

Decoding an encoded value gives the same value, to the last bit. A message whose
numbers cannot be such a value raises Dropped.
"""

import math

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from airrace import lcmtypes
from airrace.common.immutable import read_only
from airrace.hitl.link.packets import MALFORMED, NOT_FINITE, Dropped
from airrace.systems.referee_status import GateCrossing, RefereeStatus
from airrace.systems.types import CameraInfo, ExplorerEvent, ExplorerStatus
from airrace.track.gate_map import GateEstimate, GateMap, MarkerEstimate
from airrace.vehicle.state import as_state


def check_finite(*values) -> None:
    """Raises Dropped unless all numbers, and those in sequences, are finite."""
    for value in values:
        if not (np.all(np.isfinite(value)) if hasattr(value, "__len__") else math.isfinite(value)):
            raise Dropped(NOT_FINITE)


def encode_state_estimate(estimate) -> lcmtypes.lcmt_state_estimate:
    """Args: estimate: see vehicle/state.py, (14,)."""
    message = lcmtypes.lcmt_state_estimate()
    numbers = estimate.tolist()
    message.time = as_state(numbers).time
    message.quaternion, message.position = as_state(numbers).quaternion, as_state(numbers).position
    message.angular_velocity = as_state(numbers).angular_velocity
    message.velocity = as_state(numbers).velocity
    return message


def decode_state_estimate(message) -> np.ndarray:
    """Returns see vehicle/state.py, (14,)."""
    numbers = [
        message.time,
        *message.quaternion,
        *message.position,
        *message.angular_velocity,
        *message.velocity,
    ]
    check_finite(numbers)
    return read_only(numbers)


def encode_rotors(values) -> lcmtypes.lcmt_rotors:
    """Args: values: one a rotor, (n,)."""
    message = lcmtypes.lcmt_rotors()
    message.count, message.value = len(values), values.tolist()
    return message


def decode_rotors(message) -> np.ndarray:
    """Returns one finite number a rotor, (n,)."""
    check_finite(message.value)
    return read_only(message.value)


def encode_rotor_status(rotor_status, rotor_speeds) -> lcmtypes.lcmt_rotor_status:
    """Args: rotor_status: of RotorBank, (1 + 2n,). rotor_speeds: in it already, (n,)."""
    message, n = lcmtypes.lcmt_rotor_status(), len(rotor_speeds)
    time, *speeds = rotor_status.tolist()
    message.time, message.count, message.speed, message.expected = (time, n, speeds[:n], speeds[n:])
    return message


def decode_rotor_status(message) -> dict:
    """Returns the values by port: rotor_status, (1 + 2n,), and rotor_speeds, (n,)."""
    report = [message.time, *message.speed, *message.expected]
    check_finite(report)
    return {"rotor_status": read_only(report), "rotor_speeds": read_only(message.speed)}


def decode_rotor_losses(message) -> np.ndarray:
    """Returns when each rotor was lost (s), infinite for those that work, (n,)."""
    if any(math.isnan(time) or time < 0.0 for time in message.value):
        raise Dropped(NOT_FINITE)
    return read_only(message.value)


def encode_camera_info(info: CameraInfo) -> lcmtypes.lcmt_camera_info:
    """Args: info: of the camera."""
    message = lcmtypes.lcmt_camera_info()
    message.width, message.height = info.width, info.height
    for name in ("K", "D", "R", "P"):
        setattr(message, name, getattr(info, name).ravel().tolist())
    message.R_BC = info.X_BC.rotation().matrix().ravel().tolist()
    message.p_BC = info.X_BC.translation().tolist()
    return message


def decode_camera_info(message) -> CameraInfo:
    """Returns the camera's calibration."""
    check_finite(message.K, message.D, message.R, message.P, message.R_BC, message.p_BC)
    if not (0 < message.width <= 8192 and 0 < message.height <= 8192):
        raise Dropped(MALFORMED)
    try:
        R_BC = RotationMatrix(np.reshape(message.R_BC, (3, 3)))
    except (RuntimeError, ValueError):  # not a rotation
        raise Dropped(MALFORMED) from None
    return CameraInfo(
        width=message.width,
        height=message.height,
        K=read_only(np.reshape(message.K, (3, 3))),
        D=read_only(message.D),
        R=read_only(np.reshape(message.R, (3, 3))),
        P=read_only(np.reshape(message.P, (3, 4))),
        X_BC=RigidTransform(R_BC, message.p_BC),
    )


def encode_gate_map(gate_map: GateMap) -> lcmtypes.lcmt_gate_map:
    """Args: gate_map: the map."""
    message = lcmtypes.lcmt_gate_map()
    message.time = gate_map.time
    message.num_markers, message.num_gates = len(gate_map.markers), len(gate_map.gates)
    for marker in gate_map.markers:
        each = lcmtypes.lcmt_marker_estimate()
        each.id, each.count, each.outliers = marker.id, marker.count, marker.outliers
        for name in ("p_WM", "variance", "normal"):
            setattr(each, name, np.asarray(getattr(marker, name)).tolist())
        message.markers.append(each)
    for gate in gate_map.gates:
        each = lcmtypes.lcmt_gate_estimate()
        each.number, each.p_WG = gate.number, np.asarray(gate.p_WG).tolist()
        each.heading, each.spacing = gate.heading, gate.spacing
        message.gates.append(each)
    message.detections, message.out_of_range = gate_map.detections, gate_map.out_of_range
    message.num_refused = len(gate_map.refused)
    message.refused_reasons = list(gate_map.refused)
    message.refused_counts = list(gate_map.refused.values())
    return message


def decode_gate_map(message) -> GateMap:
    """Returns the map."""
    check_finite(message.time)
    for each in message.markers:
        check_finite(each.p_WM, each.normal)
        if np.isnan(each.variance).any():
            raise Dropped(NOT_FINITE)
    for each in message.gates:
        check_finite(each.p_WG, each.heading, each.spacing)
    return GateMap(
        time=message.time,
        markers=tuple(
            MarkerEstimate(
                m.id,
                m.count,
                m.outliers,
                read_only(m.p_WM),
                read_only(m.variance),
                read_only(m.normal),
            )
            for m in message.markers
        ),
        gates=tuple(
            GateEstimate(g.number, read_only(g.p_WG), g.heading, g.spacing) for g in message.gates
        ),
        detections=message.detections,
        out_of_range=message.out_of_range,
        refused=dict(zip(message.refused_reasons, message.refused_counts)),
    )


def encode_explorer_status(status: ExplorerStatus) -> lcmtypes.lcmt_explorer_status:
    """Args: status: of the explorer."""
    message = lcmtypes.lcmt_explorer_status()
    message.state, message.reason, message.since = status.state, status.reason, status.since
    message.num_gates, message.gates = len(status.gates), list(status.gates)
    message.closed = status.closed_at is not None
    message.closed_at = status.closed_at if message.closed else 0.0
    message.done, message.num_events = status.done, len(status.events)
    for event in status.events:
        each = lcmtypes.lcmt_explorer_event()
        each.time, each.state, each.reason = event.time, event.state, event.reason
        message.events.append(each)
    return message


def decode_explorer_status(message) -> ExplorerStatus:
    """Returns the explorer's status."""
    check_finite(message.since, message.closed_at, [event.time for event in message.events])
    return ExplorerStatus(
        state=message.state,
        reason=message.reason,
        since=message.since,
        gates=tuple(message.gates),
        closed_at=message.closed_at if message.closed else None,
        done=bool(message.done),
        events=tuple(ExplorerEvent(e.time, e.state, e.reason) for e in message.events),
    )


def encode_referee_status(report: RefereeStatus) -> lcmtypes.lcmt_referee_status:
    """Args: report: of the referee."""
    message = lcmtypes.lcmt_referee_status()
    message.num_crossings = len(report.crossings)
    for crossing in report.crossings:
        each = lcmtypes.lcmt_gate_crossing()
        for name, value in vars(crossing).items():
            setattr(each, name, value)
        message.crossings.append(each)
    message.finished, message.dnf_reason = report.finished, report.dnf_reason or ""
    message.over, message.end_time = report.over, report.end_time or 0.0
    message.collisions = report.collisions
    return message


def decode_referee_status(message) -> RefereeStatus:
    """Returns the referee's report."""
    check_finite(message.end_time)
    for each in message.crossings:
        check_finite(each.time, each.offset, each.max_speed)
    return RefereeStatus(
        crossings=tuple(
            GateCrossing(c.time, c.gate, c.lap, c.offset, c.max_speed) for c in message.crossings
        ),
        finished=bool(message.finished),
        dnf_reason=message.dnf_reason or None,
        end_time=message.end_time if message.over else None,
        collisions=message.collisions,
    )
