"""Routes that keep clear of pylons and pass the right gates only."""

from collections.abc import Iterable, Sequence

import numpy as np

from airrace.systems.exploring.exploration import gate_pose, known_gates, known_pylons
from airrace.track import PYLON_HEIGHT
from airrace.track.gate_map import GateEstimate, GateMap
from airrace.trajopt.feasibility import pylon_distances
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.flight_limits import MIN_HEIGHT

ABOVE_PYLONS = PYLON_HEIGHT + 3.0  # m
_RATE = 50.0  # Hz
_TOLERANCE = 0.05  # m, by which a leg that starts too near may come nearer
_PIECE = 10.0  # m, between waypoints above the pylons: about as long as the climb
_AT_GATE = 0.3  # m, from a gate's plane: it may have been passed already


def positions(leg: FlatTrajectory, after: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Returns times (s), (n,), and positions (m), (3, n), on a leg after a time, at 50 Hz."""
    after = min(after, leg.duration)
    times = np.linspace(after, leg.duration, int(_RATE * (leg.duration - after)) + 2)
    return times, leg.positions(times)


def is_clear(
    leg: FlatTrajectory,
    gate_map: GateMap,
    clearance: float,
    through: Iterable[int] = (),
    after: float = 0.0,
) -> bool:
    """Whether a leg keeps clear of everything known.

    It keeps its height and its distance from every known pylon; if it starts nearer, it
    must not come nearer. Of the known gates, also those of which one board was observed,
    it passes the right ones, in order and in their direction.

    Args:
        leg: to check.
        gate_map: the map.
        clearance: to keep from pylons' axes (m).
        through: numbers of the gates that it has to pass, in order.
        after: time on the leg from which on it is checked (s).
    """
    times, p = positions(leg, after)
    distances = pylon_distances(p, known_pylons(gate_map))
    if np.any(distances < np.minimum(clearance, distances[0] - _TOLERANCE)):
        return False
    if p[2].min() < min(MIN_HEIGHT, p[2, 0] - _TOLERANCE):
        return False
    passed = [
        number if forward else None
        for _, number, forward in gate_crossings(times, p, known_gates(gate_map))
    ]
    expected = list(through)
    if expected and len(passed) < len(expected):
        first = next((g for g in gate_map.gates if g.number == expected[0]), None)
        if first is not None and abs((p[:, 0] - first.p_WG) @ first.forward) < _AT_GATE:
            expected = expected[1:]
    return passed == expected


def gate_crossings(times: np.ndarray, p: np.ndarray, gates: Iterable[GateEstimate]) -> list:
    """Returns when a path crosses gates, below the tips of their pylons.

    Args: times: (n,) s. p: positions at those times, (3, n) m. gates: GateEstimates.

    Returns:
        (time, number, forward) in order: when (s), which gate, and whether in the
        direction of flight.
    """
    result = []
    for gate in gates:
        offset = p - gate.p_WG[:, None]
        along = gate.forward @ offset
        for k in np.flatnonzero((along[:-1] < 0) != (along[1:] < 0)):
            s = along[k] / (along[k] - along[k + 1])
            at = offset[:, k] + s * (offset[:, k + 1] - offset[:, k])
            beside = gate.forward[1] * at[0] - gate.forward[0] * at[1]
            if abs(beside) < gate.spacing / 2 and gate.p_WG[2] + at[2] < PYLON_HEIGHT:
                time = times[k] + s * (times[k + 1] - times[k])
                result.append((time, gate.number, bool(along[k] < 0)))
    return sorted(result)


def route_above_pylons(
    start: Sequence[float] | np.ndarray, goal: Sequence[float] | np.ndarray
) -> list:
    """Returns waypoints x, y, z, yaw of a route above all pylons, from one pose to another.

    There are waypoints on the straight line above, as Richter, Bry and Roy (2016) add them:
    without, a polynomial of a long distance next to one of a short climb overshoots by as
    much as that distance.
    """
    climb, descend = (
        np.array([*pose[:2], max(pose[2], ABOVE_PYLONS), goal[3]]) for pose in (start, goal)
    )
    pieces = max(int(np.ceil(np.linalg.norm(descend - climb) / _PIECE)), 1)
    across = np.linspace(climb, descend, pieces + 1)
    # No climb from above the pylons, and no descent to above them.
    first, last = int(start[2] > PYLON_HEIGHT), pieces + int(goal[2] <= PYLON_HEIGHT)
    return [*across[first:last], goal]


def routes_through(
    start: np.ndarray, gates: list[GateEstimate], *, approach: float, beyond: float
) -> list:
    """Returns routes through gates, the best first.

    The last gate is new: the routes to those before it are known to be clear.

    Args:
        start: x, y, z and yaw, where all routes begin.
        gates: to pass, in order.
        approach: distance before the last gate from which it is flown through (m).
        beyond: distance beyond a gate at which a route may end (m).

    Returns: lists of waypoints x, y, z and yaw, each ending beyond the last gate.
    """
    *before, new = gates
    aside = approach * np.array([new.forward[1], -new.forward[0], 0.0, 0.0])
    passing = [gate_pose(gate) for gate in before]
    out = [gate_pose(before[-1], beyond)] if before else []
    ready = gate_pose(new, -approach)
    end = [gate_pose(new), gate_pose(new, beyond)]
    over = route_above_pylons(out[-1] if out else start, ready)
    return [
        [*passing, *end],
        [*passing, ready, *end],
        [*passing, *out, ready, *end],
        [*passing, *out, ready + aside, ready, *end],
        [*passing, *out, ready - aside, ready, *end],
        [*passing, *out, *over, *end],
    ]
