"""The explorer's decisions: pure functions of what it knows."""

import dataclasses as dc
import typing

import numpy as np

from airrace.systems import state_estimate as se
from airrace.systems.types import Detections, GateEstimate, GateMap
from airrace.track import PYLON_HEIGHT
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.flyable import pylon_distances, sample_times

_ABOVE_PYLONS = PYLON_HEIGHT + 3.0  # m
# The steps of a search: turn (degrees), steps forward, state, reason.
_SEARCH = (
    (60.0, 1, "STEP_FORWARD", "no gate in sight"),  # the turn is back from the last look
    (0.0, 1, "STEP_FORWARD", "still no gate in sight"),
    (0.0, 1, "STEP_FORWARD", "still no gate in sight"),
    (60.0, 0, "LOOK_AROUND", "no gate ahead, looking left"),
    (-120.0, 0, "LOOK_AROUND", "no gate ahead, looking right"),
)
_LEAST_SIGHTINGS = 3  # before a marker is believed: the dictionary has strays


@dc.dataclass(frozen=True)
class Now:
    """What the explorer knows at one tick.

    Attributes:
        memory: the explorer's own state.
        time: (s).
        detections, gate_map, estimate: its inputs.
    """

    memory: typing.Any
    time: float
    detections: Detections
    gate_map: GateMap
    estimate: np.ndarray


def yaw_of(estimate) -> float:
    """Returns the heading of the body's x axis (rad)."""
    w, x, y, z = estimate[se.QUATERNION]
    return float(np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z))


def tilt(estimate) -> float:
    """Returns the angle between the body's and the world's z axis (rad)."""
    w, x, y, z = estimate[se.QUATERNION] / np.linalg.norm(estimate[se.QUATERNION])
    return float(np.arccos(np.clip(1 - 2 * (x * x + y * y), -1.0, 1.0)))


def hover_pose(estimate) -> np.ndarray:
    """Returns x, y, z (m) and yaw (rad) of an estimate, (4,)."""
    return np.array([*estimate[se.POSITION], yaw_of(estimate)])


def gate_pose(gate: GateEstimate, beyond: float = 0.0) -> np.ndarray:
    """Returns x, y, z and yaw at, or a distance (m) beyond, a gate, (4,)."""
    return np.array([*(gate.p_WG + beyond * gate.forward), gate.heading])


def next_gate(now: Now, closing_range: float) -> GateEstimate | None:
    """Returns the gate to fly to, if it has just been found.

    That is the gate with the next number when both its front markers are in
    the newest image and the map knows both. Once there were three, it may
    also be gate 1 again; but that one can be seen across the track, so it
    must be near and nothing may be known of a gate with the next number.

    Args:
        now: what is known.
        closing_range: how near gate 1 must be to close the loop (m).
    """
    number = _next_number(now)
    gates = {gate.number: gate for gate in now.gate_map.gates}
    if number in gates:
        return gates[number] if _both_in_image(now, number) else None
    if number < 3 or 0 not in gates or _is_known(now, number):
        return None
    first = gates[0]
    near = np.linalg.norm(first.p_WG - now.estimate[se.POSITION]) < closing_range
    return first if near and _both_in_image(now, 0) else None


def _both_in_image(now: Now, number: int) -> bool:
    return {4 * number, 4 * number + 2} <= _ids_in_image(now)


def _ids_in_image(now: Now) -> set:
    return {marker.id for marker in now.detections.markers}


def _is_known(now: Now, number: int) -> bool:
    """Whether any marker of a gate has been seen, and not by mistake."""
    return any(
        marker.id // 4 == number and marker.count >= _LEAST_SIGHTINGS
        for marker in now.gate_map.markers
    )


def search_target(now: Now, config) -> tuple[np.ndarray, str, str]:
    """Returns where to look next.

    Args:
        now: what is known.
        config: an ExplorerConfig.

    Returns:
        (pose, state, reason): x, y, z and yaw, (4,); STEP_AROUND,
        STEP_FORWARD or LOOK_AROUND; and why.
    """
    lone = _lone_marker(now, near=config.side_offset + 2.0)
    # Braking turns the camera up: what was in sight before is still there.
    marker = lone or _marker_seen_before(now)
    # A step around that did not help would not help again: the other marker
    # may be hidden, so look from elsewhere.
    if marker is not None and not now.memory.stepped_around:
        pose = _pose_in_front(marker, config.side_distance, config.side_offset)
        name = f"marker {marker.id} of gate {marker.id // 4 + 1}"
        reason = f"only {name} in sight" if lone else f"{name} was in sight"
        return pose, "STEP_AROUND", reason
    pose = now.memory.leg.derivatives(now.memory.leg.duration, 1)[0]
    turn, ahead, state, reason = _SEARCH[now.memory.steps % len(_SEARCH)]
    if now.memory.steps == 0:
        turn = 0.0  # nothing to turn back from
    pose = pose + [0.0, 0.0, 0.0, np.deg2rad(turn)]
    step = ahead * config.step_length
    return pose + [step * np.cos(pose[3]), step * np.sin(pose[3]), 0.0, 0.0], state, reason


def ways_home(now: Now, config) -> list:
    """Returns routes through the gates still ahead and back over the start.

    Args:
        now: what is known.
        config: an ExplorerConfig.

    Returns:
        lists of x, y, z and yaw: straight home, and home above all pylons.
    """
    home, last = now.memory.home, now.memory.last
    gates = [gate_pose(gate) for gate, _ in now.memory.ahead]
    if gates:
        gates.append(gate_pose(last, config.passing_distance))
    # Up on the way out of the last gate, where nothing can stand.
    out = gate_pose(last, 2 * config.passing_distance)
    climb, descend = (np.array([*pose[:2], _ABOVE_PYLONS, pose[3]]) for pose in (out, home))
    return [[*gates, home], [*gates, climb, descend, home]]


def is_clear(leg: FlatTrajectory, gate_map: GateMap, clearance) -> bool:
    """Whether a leg keeps a clearance (m) from every pylon in the map."""
    pylons = [pylon for gate in gate_map.gates for pylon in gate.pylons]
    distances = pylon_distances(leg.sample(sample_times(leg)), np.reshape(pylons, (-1, 2)))
    return bool(distances.min(initial=np.inf) >= clearance)


def _next_number(now: Now) -> int:
    last = now.memory.last
    return 0 if last is None else last.number + 1


def _lone_marker(now: Now, near: float):
    """Returns the estimate of the only front marker in sight of the next gate.

    The left one counts only when it is near: from afar, the right one may
    just be too small to read.
    """
    number = _next_number(now)
    if _both_in_image(now, number):
        return None
    in_image = _ids_in_image(now)
    for estimate in now.gate_map.markers:
        if estimate.id not in in_image or estimate.count < _LEAST_SIGHTINGS:
            continue
        if estimate.id == 4 * number + 2:
            return estimate
        distance = np.linalg.norm(estimate.p_WM - now.estimate[se.POSITION])
        if estimate.id == 4 * number and distance < near:
            return estimate
    return None


def _marker_seen_before(now: Now):
    """Returns the estimate of a front marker of the next gate that is out of sight."""
    number = _next_number(now)
    if _ids_in_image(now) & {4 * number, 4 * number + 2}:
        return None
    known = {m.id: m for m in now.gate_map.markers if m.count >= _LEAST_SIGHTINGS}
    return known.get(4 * number + 2, known.get(4 * number))


def _pose_in_front(marker, distance, offset) -> np.ndarray:
    """Returns the pose that faces a marker from its gate's side, (4,)."""
    normal = marker.normal * [1.0, 1.0, 0.0]
    normal /= max(np.linalg.norm(normal), 1e-9)
    # As its viewer sees it, the gate lies right of the left marker.
    rightward = np.array([-normal[1], normal[0], 0.0])
    side = offset if marker.id % 4 == 0 else -offset
    p = marker.p_WM + distance * normal + side * rightward
    return np.array([*p, np.arctan2(-normal[1], -normal[0])])
