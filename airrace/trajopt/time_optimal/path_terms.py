"""Costs and constraints of a step that concern the path: nearness, smoothness, clearance, gates."""

from collections.abc import Iterator

import numpy as np

from airrace.trajopt.flight_limits import FlightConstraints
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.time_optimal.lap_spline import LapSpline, basis
from airrace.trajopt.time_optimal.lap_step import LapStep

_SPACING = 0.25  # m, of samples, or so
_SPARSE, _LOW = 10, 0.3  # samples to one constraint of height, unless it is so near (m)
_BAND, _DEPTH = 2.5, 0.05  # m, of constraints beyond the clearance, and the nearest point
_MARGIN = 0.02  # m, for what lies between samples


def proximal_cost(step: LapStep, weight: float) -> None:
    """Adds the squared change of speed, acceleration, jerk and snap of the path.

    Each is relative to its root mean square over the lap, and the mean of all is
    weighed against the time: the constraints of a step are good near the lap that
    it starts from.

    Args: weight: of a change by all of it, as a share of the lap time.
    """
    y, T = step.samples.derivatives[..., :3], step.lap.durations
    n, samples = y.shape[1:3]
    orders = np.arange(5)
    powers = T[:, None] ** -orders
    rms = np.sqrt(np.mean(np.sum((y * powers.T[:, :, None, None]) ** 2, axis=3), axis=(1, 2)))
    share = np.sqrt(weight * step.lap.duration / (n * samples))
    for leg in range(n):
        rows = np.zeros((4, 3, samples, step.size(leg)))
        for k in orders[1:]:
            by_z, by_stretch = step.derivatives(leg, k)
            scale = share * powers[leg, k] / rms[k]
            for d in range(3):
                rows[k - 1, d, :, d:-2:4] = scale * by_z
                rows[k - 1, d, :, -1] = scale * (by_stretch[:, d] - k * y[k, leg, :, d])
        rows = rows.reshape(-1, step.size(leg))
        step.least_squares(leg, rows, np.zeros(len(rows)))


def stretch_cost(step: LapStep, weight: float) -> None:
    """Adds the mean squared relative change of the legs' durations.

    Derivatives at the gates go with their powers, up to the fourth, and a short leg among long ones
    is little of what proximal_cost() weighs.

    Args: weight: as a share of the lap time.
    """
    n = len(step.lap.durations)
    for leg in range(n):
        row = np.zeros((1, step.size(leg)))
        row[0, -1] = np.sqrt(weight * step.lap.duration / n)
        step.least_squares(leg, row, np.zeros(1))


def angle_cost(step: LapStep, weight: float) -> None:
    """Adds the mean squared second derivative of the thrust-axis angle (rad/s^2).

    Args: weight: as a share of the lap time.
    """
    T, y = step.lap.durations, step.samples.derivatives[2, ..., 3]
    for leg in range(len(T)):
        by_z, _ = step.derivatives(leg, 2)
        scale = np.sqrt(weight * step.lap.duration / y.size) / T[leg] ** 2
        rows = np.zeros((len(by_z), step.size(leg)))
        rows[:, 3:-2:4] = scale * by_z
        step.least_squares(leg, rows, scale * y[leg])


def keep_clear(step: LapStep, constraints: FlightConstraints, cost: float) -> None:
    """Adds half planes that keep the path off the pylons' axes, and a least height.

    Pylons are taken for endless: no lap is meant to lead over one.

    Args: cost: of coming nearer by a metre (s).
    """
    for leg, (matrices, place) in enumerate(_places(step.lap)):
        away, distance = _from_pylons(place, constraints.pylons)
        room = distance - constraints.clearance
        nearest = distance.min(axis=0, initial=np.inf)
        which, pylon = np.nonzero((room < _BAND) & (distance < nearest + _DEPTH))
        normal = away[which, pylon] / distance[which, pylon][:, None]
        height = place[:, 2] - constraints.min_height
        low = np.flatnonzero(height < _BAND)
        low = np.union1d(low[::_SPARSE], low[height[low] < _LOW])
        gradients = np.zeros((len(which) + len(low), 1, 4))
        gradients[: len(which), 0, :2] = -normal
        gradients[len(which) :, 0, 2] = -1.0
        rooms = np.concatenate([room[which, pylon], height[low]]) - _MARGIN
        rows = step.rows(leg, np.concatenate([which, low]), gradients, 0.0, matrices)
        step.at_most(leg, rows, rooms, slack_cost=cost)


def shortfall(lap: LapSpline, constraints: FlightConstraints) -> float:
    """Returns how much nearer than allowed a lap comes to a pylon or the ground (m)."""
    lack = 0.0
    for _, place in _places(lap):
        _, distance = _from_pylons(place, constraints.pylons)
        near = np.max(constraints.clearance - distance, initial=0.0)
        lack = max(lack, near, constraints.min_height - place[:, 2].min())
    return float(lack)


def _places(lap: LapSpline) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yields leg by leg the matrices (1, k, coefficients) and places (k, 3) of samples."""
    for leg, z in enumerate(lap.coefficients()):
        length = np.linalg.norm(np.diff(z[[0, -5], :3], axis=0))
        count = 20 * int(np.clip(np.ceil(length / _SPACING / 20), 2, 25))
        matrices = basis(lap.pieces, tuple(np.arange(count) / count))[:1]
        yield matrices, matrices[0] @ z[:, :3]


def _from_pylons(place, pylons):
    """Returns vectors from pylons to samples, (k, m, 2), and their lengths."""
    away = place[:, None, :2] - np.reshape(pylons, (-1, 2))
    return away, np.maximum(np.linalg.norm(away, axis=2), 1e-6)


def crossings(lap: LapSpline, gates: GateRegions) -> tuple[np.ndarray, np.ndarray]:
    """Returns speeds at the gates that are passed, and along their headings, (k,) m/s each."""
    v = lap.gates[lap.passed, 1, :3]
    return np.linalg.norm(v, axis=1), np.sum(v * gates.forward[lap.passed], axis=1)


def sideways(lap: LapSpline, gates: GateRegions) -> float:
    """Returns the most that a gate's crossing lacks along its heading (m/s)."""
    speeds, along = crossings(lap, gates)
    return float(np.max(np.cos(gates.most_off) * speeds - along, initial=0.0))


def cross_forward(step: LapStep, gates: GateRegions, cost: float) -> None:
    """Adds that velocities at gates are near enough to their headings, if those matter.

    Args: cost: of a wrong speed (s per m/s).
    """
    most = 1.0 / np.cos(gates.most_off)
    for i in step.lap.passed if gates.most_off < np.pi else ():
        forward = gates.forward[i]
        variables, unit = step.at_gate(i, 1)
        A = np.zeros((4, 4))
        A[0, :3], A[0, 3], A[1:, :3] = most * unit * forward, 1.0, unit * np.eye(3)
        v = step.lap.gates[i, 1, :3]
        b = np.array([most * forward @ v, *v])
        step.program.AddLorentzConeConstraint(A, b, [*variables, *step.slack(cost)])
