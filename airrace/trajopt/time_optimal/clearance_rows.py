"""Room around pylons and above the ground, and gates crossed forward."""

import numpy as np

from airrace.trajopt.flyable import LOWEST, MAX_CROSSING_ANGLE
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.time_optimal.lap_spline import LapSpline, basis
from airrace.trajopt.time_optimal.lap_step import LapStep

_SPACING = 0.25  # m, of samples, or so
_SPARSE = 10  # samples to one constraint of height
_REACH, _DEPTH = 2.5, 0.05  # m, of constraints beyond the clearance, and the nearest point
_MARGIN = 0.02  # m, for what lies between samples


def keep_clear(step: LapStep, pylons, clearance, cost: float) -> None:
    """Adds half planes that keep the path off the pylons' axes, and a least height.

    Pylons are taken for endless: no lap is meant to lead over one.

    Args:
        step: to add to.
        pylons: axes, [x, y], (m, 2) m.
        clearance: from those, a number or (m,) m.
        cost: of coming nearer by a metre (s).
    """
    for leg, (matrices, place) in enumerate(_places(step.lap)):
        away, distance = _from_pylons(place, pylons)
        room = distance - clearance
        nearest = distance.min(axis=0, initial=np.inf)
        which, pylon = np.nonzero((room < _REACH) & (distance < nearest + _DEPTH))
        normal = away[which, pylon] / distance[which, pylon][:, None]
        low = np.flatnonzero(place[:, 2] < LOWEST + _REACH)[::_SPARSE]
        gradients = np.zeros((len(which) + len(low), 1, 4))
        gradients[: len(which), 0, :2] = -normal
        gradients[len(which) :, 0, 2] = -1.0
        rooms = np.concatenate([room[which, pylon] - _MARGIN, place[low, 2] - LOWEST - _MARGIN])
        rows = step.rows(leg, np.concatenate([which, low]), gradients, 0.0, matrices)
        step.at_most(leg, rows, rooms, slack_cost=cost)


def shortfall(lap: LapSpline, pylons, clearance) -> float:
    """Returns how much nearer than allowed a lap comes to a pylon or the ground (m)."""
    lack = 0.0
    for _, place in _places(lap):
        _, distance = _from_pylons(place, pylons)
        lack = max(lack, np.max(clearance - distance, initial=-np.inf), LOWEST - place[:, 2].min())
    return float(lack)


def _places(lap: LapSpline):
    """Returns leg by leg the matrices (1, k, coefficients) and places (k, 3) of samples."""
    result = []
    for leg, z in enumerate(lap.coefficients()):
        length = np.linalg.norm(np.diff(z[[0, -5], :3], axis=0))
        count = 20 * int(np.clip(np.ceil(length / _SPACING / 20), 2, 25))
        matrices = basis(lap.pieces, tuple(np.arange(count) / count))[:1]
        result.append((matrices, matrices[0] @ z[:, :3]))
    return result


def _from_pylons(place, pylons):
    """Returns vectors from pylons to samples, (k, m, 2), and their lengths."""
    away = place[:, None, :2] - np.reshape(pylons, (-1, 2))
    return away, np.maximum(np.linalg.norm(away, axis=2), 1e-6)


def cross_forward(step: LapStep, gates: GateRegions, cost: float) -> None:
    """Adds that velocities at gates are within MAX_CROSSING_ANGLE of the headings.

    Args:
        step: to add to.
        gates: see there.
        cost: of a wrong speed (s per m/s).
    """
    most = 1.0 / np.cos(MAX_CROSSING_ANGLE)
    for i in step.passed:
        forward = gates.forward[i]
        variables, unit = step.at_gate(i, 1)
        slack = step.program.NewContinuousVariables(1)
        step.program.AddBoundingBoxConstraint(0.0, np.inf, slack)
        step.program.AddLinearCost([cost], slack)
        A = np.zeros((4, 4))
        A[0, :3], A[0, 3], A[1:, :3] = most * unit * forward, 1.0, unit * np.eye(3)
        v = step.lap.gates[i, 1, :3]
        step.program.AddLorentzConeConstraint(
            A, np.array([most * forward @ v, *v]), [*variables, *slack]
        )
