"""The Codecs of what crosses the link, but for pictures and plans."""

import math

import numpy as np

from airrace import lcmtypes
from airrace.common.immutable import read_only
from airrace.hitl.link.codec import Codec, check_finite, field_codec
from airrace.hitl.link.packets import MALFORMED, NOT_FINITE, Dropped
from airrace.systems.types import (
    CameraInfo,
    ExplorerEvent,
    ExplorerStatus,
    GateCrossing,
    RefereeStatus,
)
from airrace.track.gate_map import GateEstimate, GateMap, MarkerEstimate
from airrace.vehicle.state import State, as_state, state_vector

_LARGEST_PICTURE = 8192  # px, width and height

GATE_MAP = field_codec(
    GateMap,
    lcmtypes.lcmt_gate_map,
    parts={
        "markers": field_codec(
            MarkerEstimate, lcmtypes.lcmt_marker_estimate, infinite=("variance",)
        ),
        "gates": field_codec(GateEstimate, lcmtypes.lcmt_gate_estimate),
    },
)
EXPLORER_STATUS = field_codec(
    ExplorerStatus,
    lcmtypes.lcmt_explorer_status,
    parts={"events": field_codec(ExplorerEvent, lcmtypes.lcmt_explorer_event)},
)
REFEREE_STATUS = field_codec(
    RefereeStatus,
    lcmtypes.lcmt_referee_status,
    parts={"crossings": field_codec(GateCrossing, lcmtypes.lcmt_gate_crossing)},
)
_STATE = field_codec(State, lcmtypes.lcmt_state_estimate)
STATE_ESTIMATE = Codec(
    lcmtypes.lcmt_state_estimate,
    lambda estimate: _STATE.encode(as_state(estimate)),
    lambda message: read_only(state_vector(_STATE.decode(message))),
)
_CAMERA_INFO = field_codec(CameraInfo, lcmtypes.lcmt_camera_info)


def _decode_camera_info(message) -> CameraInfo:
    if not all(0 < size <= _LARGEST_PICTURE for size in (message.width, message.height)):
        raise Dropped(MALFORMED)
    return _CAMERA_INFO.decode(message)


CAMERA_INFO = _CAMERA_INFO._replace(decode=_decode_camera_info)


def encode_rotors(values: np.ndarray) -> lcmtypes.lcmt_rotors:
    """Args: values: one a rotor, (n,)."""
    message = lcmtypes.lcmt_rotors()
    message.count, message.value = len(values), values.tolist()
    return message


def decode_rotors(message) -> np.ndarray:
    """Returns one finite number a rotor, (n,)."""
    check_finite(message.value)
    return read_only(message.value)


def decode_rotor_losses(message) -> np.ndarray:
    """Returns when each rotor was lost (s), infinite for those that work, (n,)."""
    if any(math.isnan(time) or time < 0.0 for time in message.value):
        raise Dropped(NOT_FINITE)
    return read_only(message.value)


ROTORS = Codec(lcmtypes.lcmt_rotors, encode_rotors, decode_rotors)
ROTOR_LOSSES = ROTORS._replace(decode=decode_rotor_losses)


def encode_rotor_status(rotor_status, rotor_speeds) -> lcmtypes.lcmt_rotor_status:
    """Args: rotor_status: of RotorBank, (1 + 2n,). rotor_speeds: in it already, (n,)."""
    message, n = lcmtypes.lcmt_rotor_status(), len(rotor_speeds)
    time, *speeds = rotor_status.tolist()
    message.time, message.count, message.speed, message.expected = time, n, speeds[:n], speeds[n:]
    return message


def decode_rotor_status(message) -> dict:
    """Returns the values by port: rotor_status, (1 + 2n,), and rotor_speeds, (n,)."""
    status = [message.time, *message.speed, *message.expected]
    check_finite(status)
    return {"rotor_status": read_only(status), "rotor_speeds": read_only(message.speed)}


ROTOR_STATUS = Codec(lcmtypes.lcmt_rotor_status, encode_rotor_status, decode_rotor_status)


def of_size(codec: Codec, n: int) -> Codec:
    """Returns a Codec that drops messages of another number of rotors than n."""

    def decode(message):
        if message.count != n:
            raise Dropped(MALFORMED)
        return codec.decode(message)

    return codec._replace(decode=decode)
