"""How far from pylons plans keep, and when a map has changed."""

from collections.abc import Iterable, Sequence

import numpy as np

from airrace.math.angles import wrap_angle
from airrace.track import GateEstimate, MarkerEstimate

# m, for what the controller leaves, and the estimate of the state: if it is not known; and of it,
# for the estimate alone.
CONTROLLER, _ESTIMATE = 0.3, 0.1
_FARTHEST = 1.0  # m, for the same, however badly the drone follows
_STEPS = 20.0  # a metre, of what is kept for that, so that a plan stays the same for a while
_SIGMAS = 3.0
_MOST, _SHARE = 1.0, 1 / 8  # m, for the map, and of a gate's width: it must stay passable
_NOISE = 0.1  # m: smaller moves of an estimate are its own correction
_CHANGED = 0.02  # m, by which a map differs from one that gave no plan
_TURN = 5.0  # m, from a gate's midpoint to what turns with its heading


def pylon_margins(
    gates: Sequence[GateEstimate],
    markers: Iterable[MarkerEstimate],
    moved: float = 0.0,
    tracking: np.ndarray | float = CONTROLLER,
) -> np.ndarray:
    """Returns the margin between the drone and the boards of each pylon, (2n,) m.

    That is what the controller needs there, three standard deviations of the map, and how far gates
    move: it falls as the map gets better.

    Args:
        gates: GateEstimates, n of them; left and right pylons alternate in the result.
        markers: MarkerEstimates of the map; missing markers add no margin.
        moved: how far gates may move until they are passed (m): as far as they moved in the
            last lap; for the first lap, an assumption.
        tracking: what the controller needs at each gate (m), (n,), see tracking_margins().
    """
    sigmas = {}
    for marker in markers:
        pylon = marker.id // 2  # its two faces
        sigma = float(np.sqrt(np.max(marker.variance[:2])))
        sigmas[pylon] = max(sigmas.get(pylon, 0.0), sigma if np.isfinite(sigma) else _MOST)
    room = np.array(
        [_SIGMAS * sigmas.get(2 * gate.number + side, 0.0) for gate in gates for side in (0, 1)]
    )
    most = np.repeat([min(_MOST, _SHARE * gate.spacing) for gate in gates], 2)
    controller = np.repeat(np.broadcast_to(tracking, len(gates)), 2)
    return controller + np.minimum(room + (moved if moved > _NOISE else 0.0), most)


def tracking_margins(squares: np.ndarray, least: float) -> np.ndarray:
    """Returns what the controller needs at gates, as it has followed plans there, (n,) m.

    That is a tube of three standard deviations about the plan, as measured in flight, and room for
    the estimate: such tubes are how robust model predictive control keeps its constraints, Mayne,
    Seron and Rakovic, "Robust model predictive control of constrained linear systems with bounded
    disturbances" (Automatica 2005).

    Args:
        squares: mean square of the error across the path near each gate (m^2), (n,).
        least: that is always kept (m).
    """
    tube = np.clip(_ESTIMATE + _SIGMAS * np.sqrt(squares), least, _FARTHEST)
    return np.round(_STEPS * tube) / _STEPS


# Mean square of a drone that needs just CONTROLLER (m^2): before anything is known.
UNKNOWN_SQUARE = ((CONTROLLER - _ESTIMATE) / _SIGMAS) ** 2


def has_changed(gates: Sequence[GateEstimate], before: Sequence[GateEstimate]) -> bool:
    """Whether a map may give a plan where the map before gave none.

    Args: gates, before: GateEstimates.
    """
    numbers = [{gate.number for gate in each} for each in (gates, before)]
    return numbers[0] != numbers[1] or not largest_move(gates, before) <= _CHANGED


def largest_move(gates: Sequence[GateEstimate], before: Sequence[GateEstimate]) -> float:
    """Returns how far a gate or its pylons are from where they were (m).

    Args: gates, before: GateEstimates; those that are in both matter.
    """
    known = {gate.number: gate for gate in before}
    moves = []
    for gate in gates:
        if gate.number not in known:
            continue
        old = known[gate.number]
        turn = wrap_angle(gate.heading - old.heading)
        moves += [
            np.linalg.norm(gate.p_WG - old.p_WG),
            _TURN * abs(turn),
            abs(gate.spacing - old.spacing),
        ]
    return float(np.max(moves, initial=0.0))
