"""The Codecs of what crosses the link, but for pictures and plans."""

from typing import NamedTuple

import numpy as np

from airrace import lcmtypes
from airrace.common.immutable import read_only
from airrace.hitl.link.codec import field_codec
from airrace.hitl.link.packets import MALFORMED, Dropped
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
STATE_ESTIMATE = field_codec(State, lcmtypes.lcmt_state_estimate).of(
    as_state, lambda state: read_only(state_vector(state))
)


class _Rotors(NamedTuple):
    value: np.ndarray


class _RotorStatus(NamedTuple):
    time: float
    speed: np.ndarray
    expected: np.ndarray


def _checked_camera_info(info: CameraInfo) -> CameraInfo:
    if not all(0 < size <= _LARGEST_PICTURE for size in (info.width, info.height)):
        raise Dropped(MALFORMED)
    return info


def _checked_losses(losses: _Rotors) -> np.ndarray:
    if np.any(losses.value < 0.0):
        raise Dropped(MALFORMED)
    return losses.value


CAMERA_INFO = field_codec(CameraInfo, lcmtypes.lcmt_camera_info).of(
    lambda info: info, _checked_camera_info
)
# One number a rotor, (n,).
ROTORS = field_codec(_Rotors, lcmtypes.lcmt_rotors).of(_Rotors, lambda rotors: rotors.value)
# When each was lost (s), infinite for those that work, (n,).
ROTOR_LOSSES = field_codec(_Rotors, lcmtypes.lcmt_rotors, infinite=("value",)).of(
    _Rotors, _checked_losses
)
# Of RotorBank, (1 + 2n,).
ROTOR_STATUS = field_codec(_RotorStatus, lcmtypes.lcmt_rotor_status).of(
    lambda status: _RotorStatus(status[0], *np.split(status[1:], 2)),
    lambda status: read_only(np.hstack(status)),
)
