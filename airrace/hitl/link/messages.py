"""The Codecs of what crosses the link, but for pictures and plans."""

from typing import NamedTuple

import numpy as np

from airrace import lcmtypes
from airrace.common.immutable import read_only
from airrace.hitl.link.codec import field_codec
from airrace.hitl.link.packets import MALFORMED, Dropped
from airrace.systems.estimation.navigation import Navigation, as_navigation, navigation_vector
from airrace.systems.sensing.imu_samples import ImuSamples, as_samples
from airrace.systems.types import (
    ExplorerEvent,
    ExplorerStatus,
    GateCrossing,
    PolicyStatus,
    RefereeStatus,
)
from airrace.track.gate_map import GateEstimate, GateMap, MarkerEstimate
from airrace.vehicle.camera_info import CameraInfo
from airrace.vehicle.state import State, as_state, state_vector

_LARGEST_PICTURE = 8192  # px, width and height

GATE = field_codec(GateEstimate, lcmtypes.lcmt_gate_estimate)
GATE_MAP = field_codec(
    GateMap,
    lcmtypes.lcmt_gate_map,
    parts={
        "markers": field_codec(
            MarkerEstimate, lcmtypes.lcmt_marker_estimate, infinite=("variance",)
        ),
        "gates": GATE,
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
POLICY_STATUS = field_codec(PolicyStatus, lcmtypes.lcmt_policy_status)
STATE_ESTIMATE = field_codec(State, lcmtypes.lcmt_state_estimate).of(
    as_state, lambda state: read_only(state_vector(state))
)
# Of GateSlam, (17,).
NAVIGATION = field_codec(Navigation, lcmtypes.lcmt_navigation).of(
    as_navigation, lambda state: read_only(navigation_vector(state))
)


class _Rotors(NamedTuple):
    value: np.ndarray


class _RotorStatus(NamedTuple):
    time: float
    speed: np.ndarray
    expected: np.ndarray


class _ImuMessage(NamedTuple):
    time: np.ndarray
    angular_velocity: np.ndarray
    specific_force: np.ndarray
    is_finite: np.ndarray


def _as_imu_message(vector: np.ndarray) -> _ImuMessage:
    time, *vectors = as_samples(vector)
    is_finite = np.isfinite(np.hstack(vectors)).all(axis=1)
    w, f = (np.where(is_finite[:, None], v, 0.0) for v in vectors)
    return _ImuMessage(time, w, f, is_finite)


def _imu_vector(message: _ImuMessage) -> np.ndarray:
    time, *vectors, is_finite = message
    shown = (np.where(is_finite[:, None], v.reshape(-1, 3), np.nan) for v in vectors)
    return read_only(np.column_stack(ImuSamples(time, *shown)).ravel())


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
# Of Imu, (7 n,). A sensor may give NaN; a link must not: such samples are marked.
IMU = field_codec(_ImuMessage, lcmtypes.lcmt_imu).of(_as_imu_message, _imu_vector)
