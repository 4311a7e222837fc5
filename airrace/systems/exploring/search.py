"""The search for a gate that is not in sight: the order of steps, and where they lead.

How far it goes, and where it looks around, follows from the rules for tracks and is the same for
any length of a step.
"""

import functools
import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from airrace.math.angles import wrap_angle
from airrace.scenario import ExplorerConfig
from airrace.systems.exploring.clear_paths import ABOVE_PYLONS, route_above_pylons
from airrace.systems.exploring.exploration import describe_observation, gate_pose, presumed_gate
from airrace.systems.exploring.explorer_memory import Situation
from airrace.systems.perception.marker_pose import GATE_SPACING
from airrace.track import BOARD_OFFSET
from airrace.track.gate_map import GateEstimate
from airrace.track.rules import FARTHEST_VIEW, LENGTHS, TURN

_ON_THE_SPOT = 2.0  # m
_IN_VIEW = math.radians(20.0)  # of the heading
_READING = 0.6  # of side_distance, from where a known gate is read for sure
_LEAST_STEP = 1e-3  # m
_SURE_VIEW = 24.0  # m, from where a marker is read, also by a worse camera than the rules' one
_ASIDE = 4.0  # m, to the side, of a step that is not clear straight on
# The longest leg straight on from a gate's midpoint (m): to the next left pylon, as the rules
# allow it, and to the midpoint beside it.
_LONGEST_LEG = LENGTHS[1] + GATE_SPACING / 2 * math.sin(TURN)


class Step(NamedTuple):
    """One step of a search."""

    #: state, reason: of the explorer, when it takes the step
    state: str
    reason: str
    routes: list  #: lists of waypoints x, y, z and yaw that lead there, the best first
    #: steps, steps_around: numbers of steps, and of steps around a gate, in the search so far with
    #: this one
    steps: int
    steps_around: int


class _Move(NamedTuple):
    """A viewpoint relative to the base: beyond the last gate, or over the start."""

    #: state, reason: see Step
    state: str
    reason: str
    along: float = 0.0  #: distance from the base (m)
    bearing: float = 0.0  #: where that is, left of the base's heading (degrees)
    yaw: float = 0.0  #: of the drone, left of the bearing (degrees)
    above: bool = False  #: whether above all pylons, where no obstacle is


def _look_around(along, *angles, **where):
    reason = "no gate ahead, looking {:.0f} degrees {}"
    return [
        _Move(
            "LOOK_AROUND",
            reason.format(abs(angle), "left" if angle > 0 else "right"),
            along,
            yaw=angle,
            **where,
        )
        for angle in angles
    ]


_ALL_ROUND = (60.0, -60.0, -120.0, 180.0, 120.0)
# Bearings (degrees) and distances (parts of the reach) of viewpoints above the pylons. On each
# bearing, the next viewpoint is well within what can be read from the last.
_FROM_ABOVE = [(0, 0.2), (0, 0.4), (0, 0.6), (0, 0.8), (0, 1.0)]
_FROM_ABOVE += [(50, 0.4), (50, 0.8), (-50, 0.4), (-50, 0.8), (110, 0.4), (-110, 0.4), (180, 0.4)]


def _reach(config: ExplorerConfig) -> float:
    """Returns how far beyond a base the next gate may be (m)."""
    return max(_LONGEST_LEG - config.passing_distance, 0.0)


@functools.cache
def _straight_on(reach: float, step_length: float, *looks: float) -> tuple[_Move, ...]:
    """Returns steps forward, and looking around on the way.

    Args:
        reach: where the last step ends (m); that may be shorter than the others.
        step_length: of the others (m).
        looks: distances (m); it looks around where the step ends that gets there.
    """
    moves, along = [], 0.0
    for k in range(math.ceil((reach - _LEAST_STEP) / step_length)):
        before, along = along, min((k + 1) * step_length, reach)
        reason = "still no gate in sight" if k else "no gate in sight"
        moves.append(_Move("STEP_FORWARD", reason, along))
        if any(before < look <= along for look in looks):
            moves += _look_around(along, 60, -60)
    return tuple(moves)


def _search_ahead(now: Situation, config: ExplorerConfig) -> tuple[_Move, ...]:
    """Returns the moves of a search before the drone is lost."""
    if now.last is None:
        # By the rules, gate 1 is so near that it can be read from the start.
        first = tuple(_look_around(0.0, *_ALL_ROUND))
        looks = FARTHEST_VIEW / 2, FARTHEST_VIEW
        return first + _straight_on(FARTHEST_VIEW, config.step_length, *looks)
    # The next gate is straight ahead. Where it first looks around it would have been read, however
    # far it is, unless something hides it.
    reach = _reach(config)
    return _straight_on(reach, config.step_length, reach - _SURE_VIEW, reach)


@functools.cache
def _search_when_lost(reach: float) -> tuple[_Move, ...]:
    """Returns the moves after those ahead, which begin anew when all were in vain."""
    moves = [
        _Move("GO_BACK", "lost"),
        *_look_around(0.0, *_ALL_ROUND),
        _Move("LOOK_FROM_ABOVE", "lost, looking from above the pylons", above=True),
        *_look_around(0.0, *_ALL_ROUND, above=True),
    ]
    for bearing, part in _FROM_ABOVE:
        along, reason = part * reach, "lost, on above the pylons"
        moves.append(_Move("LOOK_FROM_ABOVE", reason, along, bearing, above=True))
        moves += _look_around(along, 60, -60, bearing=bearing, above=True)
    return tuple(moves)


def next_steps(now: Situation, config: ExplorerConfig) -> Iterator[Step]:
    """Yields steps of the search, the best first; not all may be free to take.

    If a board of the gate was observed, steps around it come first. Then come the steps
    of the paper, and then those that find a gate that the original would not.

    Args: now: what is known. config: an ExplorerConfig.
    """
    gate = presumed_gate(now.gate_map, now.next_number)
    around, on = _steps_around_gate(now, config, gate), _steps_on(now, config)
    if gate is not None and is_far(now, gate, config):
        # Its other marker may just be too small to be read from here.
        first = next(on)
        if first.state == "STEP_FORWARD" and not leads_to(first.routes[0][0], gate, config):
            yield first
    yield from around
    yield from on


def step_back(now: Situation, config: ExplorerConfig) -> Step | None:
    """Returns the step by which the nearest known gate can be read; None if it is done.

    It turns to the gate while it flies to where that is seen best. Both of its sides carry markers,
    so that is on the drone's side of it.

    Args: now: what is known. config: an ExplorerConfig.
    """
    here = now.memory.goal
    distance = {n: np.linalg.norm(gate.p_WG - here[:3]) for n, gate in now.gates.items()}
    if not distance:
        return None
    gate = now.gates[min(distance, key=distance.__getitem__)]
    to_gate = gate.p_WG - here[:3]
    beyond = to_gate @ gate.forward < 0.0
    away = _READING * config.side_distance
    pose = gate_pose(gate, away if beyond else -away)
    pose[3] += math.pi if beyond else 0.0
    is_there = np.linalg.norm(pose[:3] - here[:3]) < _ON_THE_SPOT
    if is_there and abs(wrap_angle(pose[3] - here[3])) < _IN_VIEW:
        return None
    reason = f"unsure of its place, looking at gate {gate.number + 1} again"
    routes = [[pose], route_above_pylons(here, pose)]
    return Step("LOOK_BACK", reason, routes, now.memory.steps, now.memory.steps_around)


def is_lost(now: Situation, config: ExplorerConfig) -> bool:
    """Whether the search ahead was in vain, and the drone went back."""
    return now.memory.steps > len(_search_ahead(now, config))


def is_far(now: Situation, gate: GateEstimate, config: ExplorerConfig) -> bool:
    """Whether a gate is farther away than where both its markers should be in view."""
    return np.linalg.norm(now.memory.goal[:3] - gate.p_WG) > config.side_distance


def leads_to(goal: np.ndarray, gate: GateEstimate, config: ExplorerConfig) -> bool:
    """Whether a step to x, y, z, yaw ends too near to a gate that is not yet in the map."""
    return (goal[:3] - gate.p_WG) @ gate.forward > -config.approach_distance


def _steps_on(now: Situation, config: ExplorerConfig) -> Iterator[Step]:
    memory = now.memory
    base = memory.home if now.last is None else gate_pose(now.last, config.passing_distance)
    ahead, when_lost = _search_ahead(now, config), _search_when_lost(_reach(config))
    back_to = "the start" if now.last is None else f"gate {now.last.number + 1}"
    for steps in itertools.count(memory.steps):
        lost = steps - len(ahead)
        move = ahead[steps] if lost < 0 else when_lost[lost % len(when_lost)]
        going_back = move.state == "GO_BACK"
        reason = f"{move.reason}, back to {back_to}" if going_back else move.reason
        routes = _routes(move, memory.goal, _pose(move, base))
        steps_around = 0 if going_back else memory.steps_around
        yield Step(move.state, reason, routes, steps + 1, steps_around)


def _steps_around_gate(
    now: Situation, config: ExplorerConfig, gate: GateEstimate | None
) -> Iterator[Step]:
    if gate is None:
        return
    reason = describe_observation(now, gate.number)
    poses = _poses_in_front(gate, config)
    for k in range(now.memory.steps_around, len(poses)):
        routes = [[poses[k]], route_above_pylons(now.memory.goal, poses[k])]
        yield Step("STEP_AROUND", reason, routes, now.memory.steps, k + 1)


def _poses_in_front(gate: GateEstimate, config: ExplorerConfig) -> list:
    """Returns poses from which both front markers of a gate should be in view."""
    # From the boards, not from the axes of their pylons.
    far, side = config.side_distance + BOARD_OFFSET, config.side_offset
    rightward = np.array([gate.forward[1], -gate.forward[0], 0.0, 0.0])
    middle, toward = gate_pose(gate, -0.8 * far), np.arctan2(side, 0.8 * far)
    return [
        gate_pose(gate, -far),
        gate_pose(gate, -0.6 * far),
        gate_pose(gate, -0.4 * far),
        middle + side * rightward + [0.0, 0.0, 0.0, toward],
        middle - side * rightward - [0.0, 0.0, 0.0, toward],
        gate_pose(gate, -far) + [0.0, 0.0, ABOVE_PYLONS - gate.p_WG[2], 0.0],
    ]


def _pose(move: _Move, base: np.ndarray) -> np.ndarray:
    """Returns x, y, z and yaw, (4,)."""
    bearing = base[3] + np.deg2rad(move.bearing)
    x, y = base[0] + move.along * np.cos(bearing), base[1] + move.along * np.sin(bearing)
    z = ABOVE_PYLONS if move.above else base[2]
    return np.array([x, y, z, bearing + np.deg2rad(move.yaw)])


def _routes(move: _Move, start: np.ndarray, goal: np.ndarray) -> list:
    if move.above:
        return [route_above_pylons(start, goal)]
    if move.state != "STEP_FORWARD":
        # A lost drone may be among pylons that are not known.
        near = np.linalg.norm(goal[:3] - start[:3]) < _ON_THE_SPOT
        return [[goal] if near else route_above_pylons(start, goal)]
    aside = _ASIDE * np.array([-np.sin(goal[3]), np.cos(goal[3]), 0.0, 0.0])
    half = (start + goal) / 2 * [1, 1, 1, 0] + goal * [0, 0, 0, 1]
    return [[goal], [goal + aside], [goal - aside], [half], route_above_pylons(start, goal)]
