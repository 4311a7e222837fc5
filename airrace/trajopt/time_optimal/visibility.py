"""The next gate in the camera's view: bounds on the thrust-axis angle."""

import numpy as np

from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.time_optimal.lap_samples import LapSamples
from airrace.trajopt.time_optimal.lap_step import LapStep

LEAST_RANGE = 8.0  # m, to a gate: nearer, its pylons leave the picture
_STEP = 1e-30  # of complex-step derivatives


def angle_bounds(
    samples: LapSamples, gates: GateRegions, half_view: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns between which thrust-axis angles the next gate's midpoint is within the view.

    That is by bearing: pitch and roll tilt the camera as the flight demands.

    Args:
        samples: of the lap.
        gates: that it leads through; of an open one with both ends.
        half_view: greatest angle between bearing and heading (rad).

    Returns:
        (low, high, seen): for every sample, (n, samples) rad, the angles at
        the bounds, continuous around the lap; and where the bounds matter.
    """
    n, count = samples.derivatives.shape[1:3]
    to_gate, seen, follow = _to_next_gate(samples, gates, half_view)
    # Beside a gate its bearing turns fast; its direction of flight takes the place of it.
    ahead = np.repeat(np.roll(gates.forward, -1, axis=0)[:n, :2], count, axis=0).T
    to_gate = np.where(follow.ravel(), to_gate, ahead)
    x, y = samples.axes
    b = np.cross(x, y, axis=0)

    def angle(turn):
        X, Y = _seen_from_axes(to_gate, turn, b, samples.axes)
        return np.arctan2(Y, X)

    centre = np.unwrap(angle(0.0))
    current = samples.derivatives[0, ..., 3].ravel()
    centre += 2 * np.pi * np.round(np.mean(current - centre) / (2 * np.pi))
    low = centre - (centre - angle(-half_view)) % (2 * np.pi)
    high = centre + (angle(half_view) - centre) % (2 * np.pi)
    return low.reshape(n, count), high.reshape(n, count), seen


def _to_next_gate(samples, gates, half_view):
    """Returns the horizontal vectors to the next midpoint, (2, N), and where it is far.

    That is first farther than LEAST_RANGE, then also the first sample that is nearer; and none if
    it may be anywhere.
    """
    places = samples.derivatives[0, ..., :3]
    target = np.roll(gates.midpoints, -1, axis=0)[: len(places), None]
    to_gate = (target - places)[..., :2]
    step = np.linalg.norm(samples.derivatives[1, ..., :2], axis=2) / to_gate.shape[1]
    distance = np.linalg.norm(to_gate, axis=2)
    least = LEAST_RANGE if half_view < np.pi else np.inf
    return to_gate.reshape(-1, 2).T, distance > least, distance > least - step


def _seen_from_axes(to_gate, turn, b, axes):
    """Returns what the body's x axis has along two axes, if it heads off a gate by a turn."""
    c, s = np.cos(turn), np.sin(turn)
    h = np.array(
        [c * to_gate[0] - s * to_gate[1], s * to_gate[0] + c * to_gate[1], 0.0 * to_gate[0]]
    )
    x_B = h - np.sum(h * b, axis=0) * b
    return np.sum(x_B * axes[0], axis=0), np.sum(x_B * axes[1], axis=0)


def keep_in_view(
    step: LapStep, gates: GateRegions, half_view: float, cost: float, band: float = np.inf
) -> None:
    """Adds bounds on the thrust-axis angle, see angle_bounds().

    Args:
        gates, half_view: see angle_bounds().
        cost: of leaving the view by a radian (s).
        band: about a bound (rad); samples farther from it are left out.
    """
    samples, force = step.samples, step.dynamics.force
    low, high, _ = angle_bounds(samples, gates, half_view)
    angles = samples.derivatives[0, ..., 3]
    to_gate, _, seen = _to_next_gate(samples, gates, half_view)
    for bound, sign, turn in ((high, 1.0, half_view), (low, -1.0, -half_view)):
        by_place, by_force = _bound_gradients(to_gate, force.values, turn, samples.axes)
        gradients = -np.einsum("dk,dkox->kox", by_force, force.gradients)
        gradients[:, 0, :2] -= by_place.T
        gradients[:, 0, 3] += 1.0
        by_T = -np.sum(by_force * force.by_T, axis=0)
        for leg in range(len(low)):
            room, here = sign * (bound - angles)[leg], step.of(leg)
            which = np.flatnonzero(seen[leg] & (room < band))
            rows = step.rows(leg, which, gradients[here][which], by_T[here][which])
            step.at_most(leg, sign * rows, room[which], slack_cost=cost)


def _bound_gradients(to_gate, force, turn, axes):
    """Returns the derivatives of a bound by place, (2, N), and by force, (3, N)."""
    result = []
    for i in range(5):
        g, f = to_gate.astype(complex), force.astype(complex)
        (g if i < 2 else f)[i if i < 2 else i - 2] += (-1j if i < 2 else 1j) * _STEP
        X, Y = _seen_from_axes(g, turn, f / np.sqrt(np.sum(f * f, axis=0)), axes)
        result.append((X.real * Y.imag - Y.real * X.imag) / (X.real**2 + Y.real**2) / _STEP)
    return np.array(result[:2]), np.array(result[2:])


def out_of_view(samples: LapSamples, gates: GateRegions, half_view: float) -> float:
    """Returns by how much the worst sample leaves the bounds on the angle (rad)."""
    low, high, seen = angle_bounds(samples, gates, half_view)
    angles = samples.derivatives[0, ..., 3]
    return float(np.max(np.maximum(low - angles, angles - high)[seen], initial=0.0))
