"""Ways that keep clear of pylons and lead through no gap but the right ones."""

import numpy as np

from airrace.systems.exploring.exploration import gate_pose, known_gates, known_pylons
from airrace.track import PYLON_HEIGHT
from airrace.track.gate_map import GateEstimate, GateMap
from airrace.trajopt.feasibility import MIN_HEIGHT, pylon_distances
from airrace.trajopt.flat_trajectory import FlatTrajectory

ABOVE_PYLONS = PYLON_HEIGHT + 3.0  # m
_RATE = 50.0  # Hz
_CREEP = 0.05  # m, by which one who is too near may come nearer still
_PIECE = 10.0  # m, of the way across: about as long as the climb
_AT_GATE = 0.3  # m, before a gate's plane one may be through it already


def positions(leg: FlatTrajectory, after: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Returns times (s), (n,), and positions (m), (3, n), on a leg, at 50 Hz.

    Args:
        leg: of which.
        after: since when (s).
    """
    after = min(after, leg.duration)
    times = np.linspace(after, leg.duration, int(_RATE * (leg.duration - after)) + 2)
    return times, leg.positions(times)


def is_clear(
    leg: FlatTrajectory, gate_map: GateMap, clearance: float, through=(), after: float = 0.0
) -> bool:
    """Whether a leg can be flown by what is known.

    It keeps its height, and clear of every pylon that was seen; one who is
    nearer already must not come nearer. Of the gates of which something was
    seen, it leads through the right ones, and forward.

    Args:
        leg: to check.
        gate_map: what is known.
        clearance: to keep from pylons' axes (m).
        through: numbers of the gates that it has to pass, in order.
        after: since when on the leg (s).
    """
    times, p = positions(leg, after)
    distances = pylon_distances(p, known_pylons(gate_map))
    if np.any(distances < np.minimum(clearance, distances[0] - _CREEP)):
        return False
    if p[2].min() < min(MIN_HEIGHT, p[2, 0] - _CREEP):
        return False
    passed = [
        number if forward else None
        for _, number, forward in passages(times, p, known_gates(gate_map))
    ]
    expected = list(through)
    if expected and len(passed) < len(expected):
        first = next((g for g in gate_map.gates if g.number == expected[0]), None)
        if first is not None and abs((p[:, 0] - first.p_WG) @ first.forward) < _AT_GATE:
            expected = expected[1:]
    return passed == expected


def passages(times, p, gates) -> list:
    """Returns when a path leads through gates, below the tips of their pylons.

    Args:
        times: (n,) s.
        p: positions at those times, (3, n) m.
        gates: GateEstimates.

    Returns:
        (time, number, forward) in order: when (s), through which gate, and
        whether in the direction of flight.
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


def over_the_top(start, goal) -> list:
    """Returns x, y, z, yaw of the way above all pylons, from one pose to another.

    Across, it leads through waypoints on the straight way, as Richter, Bry and Roy (2016) add
    them: a polynomial for a long way next to one for a short climb swings out by as much as
    the long way is long.
    """
    climb, descend = (
        np.array([*pose[:2], max(pose[2], ABOVE_PYLONS), goal[3]]) for pose in (start, goal)
    )
    pieces = max(int(np.ceil(np.linalg.norm(descend - climb) / _PIECE)), 1)
    across = np.linspace(climb, descend, pieces + 1)
    # Who is above them already need not climb, nor who stays there descend.
    first, last = int(start[2] > PYLON_HEIGHT), pieces + int(goal[2] <= PYLON_HEIGHT)
    return [*across[first:last], goal]


def ways(start, goal) -> list:
    """Returns routes from a pose to another, the best first: straight, or over the top."""
    return [[goal], over_the_top(start, goal)]


def ways_through(start, gates: list[GateEstimate], *, approach: float, beyond: float) -> list:
    """Returns routes through gates, the best first.

    The last gate is new: the ways to those before it are known to be good.

    Args:
        start: x, y, z and yaw of where the first route begins.
        gates: to pass, in order.
        approach: distance before the last gate from which it is flown through (m).
        beyond: distance beyond a gate at which a way may end (m).

    Returns:
        lists of x, y, z and yaw, each ending beyond the last gate.
    """
    *before, new = gates
    passing = [gate_pose(gate) for gate in before]
    out = [gate_pose(before[-1], beyond)] if before else []
    ready = gate_pose(new, -approach)
    end = [gate_pose(new), gate_pose(new, beyond)]
    over = over_the_top(out[-1] if out else start, ready)
    return [
        [*passing, *end],
        [*passing, ready, *end],
        [*passing, *out, ready, *end],
        *(
            [*passing, *out, gate_pose(new, -approach) + _aside(new, side), ready, *end]
            for side in (approach, -approach)
        ),
        [*passing, *out, *over, *end],
    ]


def _aside(gate: GateEstimate, distance: float) -> np.ndarray:
    """Returns a step to the right of the direction of flight, (4,)."""
    return np.array([gate.forward[1] * distance, -gate.forward[0] * distance, 0.0, 0.0])
