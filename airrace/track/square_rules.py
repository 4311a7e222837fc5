"""The rules for courses of square gates: legs, slopes, turns, room to fly, gates in view."""

import numpy as np

from airrace.math.angles import wrap_angle
from airrace.track.geometry import point_distances, segment_distances
from airrace.track.rules import require_rule
from airrace.track.square_track import SquareTrack

GATE_COUNTS = range(17, 21)  # of a course as raced; shorter ones are for practice
MOST_GATES = 20
LENGTH = (185.0, 215.0)  # m, of a course of GATE_COUNTS from the pad to the last gate
LEGS = (8.0, 15.0)  # m, from a gate to the next one
HEIGHTS = (1.6, 6.0)  # m, of the middle of a gate
# Of a leg, at most: the camera looks up, and sees little of what lies below.
CLIMB, DESCENT = np.deg2rad(16.0), np.deg2rad(10.0)
TURN = np.deg2rad(50.0)  # from one leg to the next, at most
# From the direction of flight through a gate to the next one. The camera sees 45 degrees to
# either side, and from 9 degrees below that direction upwards where the drone is level.
BEARING = np.deg2rad(35.0)
FACING = np.deg2rad(35.0)  # between a leg and the direction through the gate that it leads to
PITCH = 10.0  # degrees, of a gate
LEG_TO_LEG = 4.5  # m, on the ground plan, unless they meet at a gate
START_DISTANCE = (7.0, 10.0)  # m, from the pad to gate 1
START_TURN = np.deg2rad(10.0)  # from the pad's heading to gate 1
PAD_TILT_DEG = 17.8  # nose-down
_TOLERANCE = 2e-3  # m, or rad: a file holds millimetres


def check_square_rules(track: SquareTrack) -> None:
    """Raises RuleError for the first rule of this file that the course breaks."""
    way = track.way()
    legs = np.diff(way, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    n = len(track.gates)
    _check_start(track, legs[0])
    require_rule("length", np.all(_within(lengths[1:], LEGS)), f"a leg is not {LEGS} m long")
    if n in GATE_COUNTS:
        total = lengths.sum()
        require_rule("length", _within(total, LENGTH), f"it is {total:.0f} m long, not {LENGTH}")
    require_rule("height", np.all(_within(way[1:, 2], HEIGHTS)), f"a gate is not at {HEIGHTS} m")
    slopes = np.arcsin(legs[1:, 2] / lengths[1:])
    require_rule("slope", np.all(_within(slopes, (-DESCENT, CLIMB))), "a leg is too steep")
    bearings = np.arctan2(legs[:, 1], legs[:, 0])
    turns = np.abs(wrap_angle(np.diff(bearings)))
    require_rule("turn", np.all(turns <= TURN + _TOLERANCE), "it turns too much at a gate")
    headings = np.array([gate.heading for gate in track.gates])
    off = np.abs(wrap_angle(bearings - headings))  # between each leg and the gate it leads to
    require_rule("facing", np.all(off <= FACING + _TOLERANCE), "a gate does not face its leg")
    ahead = np.abs(wrap_angle(bearings[1:] - headings[:-1]))
    require_rule("visibility", np.all(ahead <= BEARING + _TOLERANCE), "a gate is not in view")
    steepest = max(abs(gate.pitch_deg) for gate in track.gates)
    require_rule("pitch", steepest <= PITCH + _TOLERANCE, f"a pitch is {steepest:.1f} degrees")
    check_legs_apart(way)


def check_legs_apart(way: np.ndarray) -> None:
    """Raises RuleError, "clearance", if legs that do not meet come near on the ground plan.

    Args: way: the pad and all gates, (k, 3) m.
    """
    starts, ends = way[:-1, :2], way[1:, :2]
    n = len(starts)
    meet = np.abs(np.arange(n) - np.arange(n)[:, None]) <= 1
    apart = np.where(meet, np.inf, segment_distances(starts, ends)).min()
    require_rule("clearance", apart >= LEG_TO_LEG - _TOLERANCE, f"legs are {apart:.1f} m apart")
    # And of each gate from legs that do not lead to or from it.
    to_legs = point_distances(way[1:, None, :2], starts, ends)
    touch = np.abs(np.arange(n)[:, None] + 0.5 - np.arange(n)) <= 0.5
    nearest = np.where(touch, np.inf, to_legs).min()
    require_rule("clearance", nearest >= LEG_TO_LEG - _TOLERANCE, "a leg is near another gate")


def _check_start(track, leg):
    require_rule(
        "start",
        _within(np.linalg.norm(leg[:2]), START_DISTANCE),
        f"the pad is not {START_DISTANCE} m before gate 1",
    )
    turn = abs(wrap_angle(np.arctan2(leg[1], leg[0]) - np.deg2rad(track.start.heading_deg)))
    require_rule("start", turn <= START_TURN + _TOLERANCE, "gate 1 is not ahead of the pad")
    down = wrap_angle(np.deg2rad(track.start.pad_tilt_direction_deg - track.start.heading_deg))
    require_rule("start", abs(down) <= _TOLERANCE, "the pad is not inclined nose-down")


def _within(values, limits):
    return (np.asarray(values) >= limits[0] - _TOLERANCE) & (
        np.asarray(values) <= limits[1] + _TOLERANCE
    )
