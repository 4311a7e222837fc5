"""What follows from what the explorer knows: the next gate, and all gates and pylons known."""

import numpy as np

from airrace.math.angles import wrap_angle
from airrace.math.quaternion import heading
from airrace.systems.exploring.explorer_memory import Situation
from airrace.systems.perception.marker_pose import GATE_SPACING
from airrace.track import BOARD_OFFSET
from airrace.track.gate_map import GateEstimate, GateMap
from airrace.vehicle.state import as_state

_LEAST_OBSERVATIONS = 3  # of a marker that is used: fewer may be misread IDs
# The layout rule, section II of the paper: the next left pylon is straight ahead of the
# left pylon, the next heading turned by 45 degrees to either side. With tolerances for
# errors of the map, and for tracks that nearly obey it:
_TURN, _TURN_TOLERANCE = np.deg2rad(45.0), np.deg2rad(15.0)
_SIDE_TOLERANCE = 2.5  # m
_MOST_TURN = np.deg2rad(80.0)  # after a gate and before the next, on any track
_STILL = 0.3  # m/s and rad/s, of a drone that stands on its pad
_FEWEST_GATES = 3  # of a track


def yaw_of(estimate: np.ndarray) -> float:
    """Returns the heading of the body's x axis (rad)."""
    return heading(as_state(estimate).quaternion)


def tilt(estimate: np.ndarray) -> float:
    """Returns the angle between the body's and the world's z axis (rad)."""
    w, x, y, z = as_state(estimate).quaternion / np.linalg.norm(as_state(estimate).quaternion)
    return float(np.arccos(np.clip(1 - 2 * (x * x + y * y), -1.0, 1.0)))


def fault_on_pad(estimate: np.ndarray, max_tilt_deg: float) -> str | None:
    """Returns why a drone on its pad must not take off, None if it may.

    Args: estimate: vector of vehicle/state.py, (14,). max_tilt_deg: that is accepted (degrees).
    """
    tilt_deg = np.rad2deg(tilt(estimate))
    if tilt_deg > max_tilt_deg:
        return f"tilted by {tilt_deg:.0f} degrees, more than {max_tilt_deg:.0f}: staying"
    state = as_state(estimate)
    motion = max(np.linalg.norm(state.velocity), np.linalg.norm(state.angular_velocity))
    return "moving, waiting for rest" if motion > _STILL else None


def hover_pose(estimate: np.ndarray) -> np.ndarray:
    """Returns x, y, z (m) and yaw (rad) of an estimate, (4,)."""
    return np.array([*as_state(estimate).position, yaw_of(estimate)])


def gate_pose(gate: GateEstimate, beyond: float = 0.0) -> np.ndarray:
    """Returns x, y, z and yaw at, or a distance (m) beyond, a gate, (4,)."""
    return np.array([*(gate.p_WG + beyond * gate.forward), gate.heading])


def next_gate(now: Situation, closing_range: float, is_lost: bool = False) -> GateEstimate | None:
    """Returns the gate to fly to, if it has just been found.

    That is the gate with the next number, once it is in the map with both pylons, or
    gate 1 again, if it closes the loop: see _closes_loop().

    Args:
        now: what is known.
        closing_range: how near gate 1 must be to close the loop (m).
        is_lost: whether the search ahead of the last gate was in vain.
    """
    if now.next_number in now.gates:
        return now.gates[now.next_number]
    return now.gates[0] if _closes_loop(now, closing_range, is_lost) else None


def front_markers(now: Situation, number: int) -> set:
    """Returns the IDs of a gate's front markers in the newest image."""
    return {4 * number, 4 * number + 2} & {marker.id for marker in now.detections.markers}


def _closes_loop(now: Situation, closing_range: float, is_lost: bool) -> bool:
    """Whether gate 1 comes after the last gate.

    Gate 1 may come into view across the track before that. So it must be near, with a
    front marker in the image; no board of a gate with the next number may be known; and
    gate 1 must stand where the layout rule has the gate after the last one. If it does
    not, both its front markers must be in the image, it must be ahead of the last gate,
    and other gates must break the rule as well, or the search must have found nothing.
    What was seen while the last gate was being passed still counts behind it.
    """
    last, first = now.last, now.gates.get(0)
    if last is None or now.next_number < _FEWEST_GATES or first is None:
        return False
    if presumed_gate(now.gate_map, now.next_number):
        return False
    if now.memory.closing:
        return True
    in_image = front_markers(now, 0)
    if not in_image:
        return False
    if np.linalg.norm(first.p_WG - as_state(now.estimate).position) > closing_range:
        return False
    if obeys_rule(last, first):
        return True
    found = [now.gates[number] for number in now.memory.status.gates if number in now.gates]
    rule_holds = all(map(obeys_rule, found, found[1:]))
    may_break_rule = is_lost or not rule_holds
    return may_break_rule and len(in_image) == 2 and _is_ahead(last, first)


def obeys_rule(gate: GateEstimate, following: GateEstimate) -> bool:
    """Whether a gate stands where the layout rule has the one after a gate."""
    to_left = following.pylons[0] - gate.pylons[0]
    aside = gate.forward[0] * to_left[1] - gate.forward[1] * to_left[0]
    turn = abs(wrap_angle(following.heading - gate.heading))
    return bool(
        to_left @ gate.forward[:2] > 0.0
        and abs(aside) < _SIDE_TOLERANCE
        and abs(turn - _TURN) < _TURN_TOLERANCE
    )


def _is_ahead(gate: GateEstimate, following: GateEstimate) -> bool:
    """Whether the straight line from one gate to another passes both in their direction."""
    line = following.p_WG - gate.p_WG
    least = np.cos(_MOST_TURN) * np.linalg.norm(line)
    return bool(line @ gate.forward > least and line @ following.forward > least)


def presumed_gate(gate_map: GateMap, number: int) -> GateEstimate | None:
    """Returns where a gate is presumed to be by the best known of its boards alone.

    Args: gate_map: with any of its four boards, or none. number: of the gate.

    Returns: None if no board of it was observed often enough.
    """
    seen = [m for m in gate_map.markers if m.id // 4 == number and m.count >= _LEAST_OBSERVATIONS]
    if not seen:
        return None
    board = min(seen, key=lambda m: (m.variance.sum(), m.id))
    out = _horizontal(board.normal)
    forward = out if board.id % 2 else -out
    rightward = np.array([forward[1], -forward[0], 0.0])
    inwards = -rightward if board.id & 2 else rightward
    return GateEstimate(
        number=number,
        p_WG=board.p_WM - BOARD_OFFSET * out + GATE_SPACING / 2 * inwards,
        heading=float(np.arctan2(forward[1], forward[0])),
        spacing=GATE_SPACING,
    )


def known_gates(gate_map: GateMap) -> list[GateEstimate]:
    """Returns the gates of the map, and the presumed ones of which less is known."""
    whole = {gate.number for gate in gate_map.gates}
    rest = sorted({marker.id // 4 for marker in gate_map.markers} - whole)
    presumed = (presumed_gate(gate_map, number) for number in rest)
    return [*gate_map.gates, *(gate for gate in presumed if gate is not None)]


def known_pylons(gate_map: GateMap) -> np.ndarray:
    """Returns the axes of all known pylons, (n, 2) m."""
    pylons = [pylon for gate in gate_map.gates for pylon in gate.pylons]
    whole = {gate.number for gate in gate_map.gates}
    pylons += [
        (marker.p_WM - BOARD_OFFSET * _horizontal(marker.normal))[:2]
        for marker in gate_map.markers
        if marker.id // 4 not in whole and marker.count >= _LEAST_OBSERVATIONS
    ]
    return np.reshape(pylons, (-1, 2))


def describe_observation(now: Situation, number: int) -> str:
    """Returns which boards of a gate were observed, in words."""
    seen = [m for m in now.gate_map.markers if m.id // 4 == number and m.count > 0]
    in_image = {marker.id for marker in now.detections.markers}
    ids = " and ".join(str(m.id) for m in seen)
    what, now_is, was = ("marker", "is", "was") if len(seen) == 1 else ("markers", "are", "were")
    behind = " from behind" if seen and all(m.id % 2 for m in seen) else ""
    if any(m.id in in_image for m in seen):
        return f"only {what} {ids} of gate {number + 1} {now_is} in sight{behind}"
    return f"{what} {ids} of gate {number + 1} {was} seen{behind}"


def heading_error(now: Situation, gate: GateEstimate) -> float:
    """Returns the angle from the drone's heading to the left, to a gate (rad)."""
    x, y, _ = gate.p_WG - as_state(now.estimate).position
    return wrap_angle(np.arctan2(y, x) - yaw_of(now.estimate))


def angle_in_words(angle: float) -> str:
    """Returns an angle (rad) to the left, e.g. "12 degrees right"."""
    return f"{abs(np.rad2deg(angle)):.0f} degrees {'left' if angle >= 0 else 'right'}"


def _horizontal(vector: np.ndarray) -> np.ndarray:
    """Returns the unit vector along the horizontal part of a vector, (3,)."""
    flat = vector * [1.0, 1.0, 0.0]
    return flat / max(np.linalg.norm(flat), 1e-9)
