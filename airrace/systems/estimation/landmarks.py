"""What is known of a gate beside its state, and how a new gate enters the filter."""

import dataclasses as dc
import math
from typing import NamedTuple

import numpy as np

from airrace.common.immutable import Immutable
from airrace.math.angles import wrap_angle
from airrace.math.small_matrices import product
from airrace.math.vec3 import rotate
from airrace.systems.estimation.gate_projection import GATE, Camera
from airrace.systems.estimation.kalman_update import (
    Belief,
    GateMeasurement,
    Innovation,
    body_axes,
    relative_covariance,
    updated,
)
from airrace.systems.estimation.navigation import as_navigation
from airrace.systems.mapping.gate_filter import (
    AT_GATE,
    GateState,
    as_gate,
    board_position,
    facing,
    gate_vector,
)
from airrace.systems.perception.marker_pose import GATE_SPACING
from airrace.systems.types import Detection

# Variances of any gate before it is seen, about where it seems to be: m^2, rad^2, m^2.
_UNKNOWN = gate_vector(GateState(np.full(3, 20.0), 1.0, 1.0)) ** 2
_FITS, _ITERATIONS = 3, 15
_LEAST_ADVANTAGE = 9.0  # squared standard deviations by which the other heading must be worse
_MOST_COST = 60.0  # of eight or sixteen coordinates of corners
_SAME_HEADING = 0.05  # rad
_MOST_HEADING_SIGMA = 0.15  # rad, of a new gate's heading to the drone's
# Sights of a new gate that have to agree before it enters, and how: m, rad, s.
_CONFIRMATIONS = 3
_NEAR, _TURN, _SOON = 2.0, 0.3, 0.5


@dc.dataclass(frozen=True, eq=False)
class Landmark(Immutable):
    """What is known of one gate in the filter, beside its state."""

    number: int  #: of the gate
    counts: dict = dc.field(default_factory=dict)  #: marker ID to how many observations count
    outliers: dict = dc.field(default_factory=dict)  #: marker ID to how many were refused
    refused_in_a_row: int = 0  #: pictures in which all its markers were refused, up to now
    is_known: bool = False  #: whether both its pylons are known well enough to fly through
    has_spacing: bool = False  #: whether the spacing that the rules say is in its state
    seen_at: float = -1.0  #: time of the newest picture that counts (s)


class Candidate(NamedTuple):
    """A gate that is not yet in the filter."""

    measurements: int  #: so far, that agree
    time: float  #: of the newest (s)
    state: np.ndarray  #: of the gate by that, (5,)


def agreeing(candidate: Candidate | None, time: float, state: np.ndarray) -> Candidate:
    """Returns the candidate after a measurement at a time (s) of a gate in a state, (5,)."""
    if candidate is not None and time - candidate.time < _SOON:
        gate, before = as_gate(state), as_gate(candidate.state)
        shift, turn = np.linalg.norm(gate.p_WG - before.p_WG), gate.heading - before.heading
        if shift < _NEAR and abs(wrap_angle(turn)) < _TURN:
            return Candidate(candidate.measurements + 1, time, state)
    return Candidate(1, time, state)


def is_confirmed(candidate: Candidate) -> bool:
    """Whether enough measurements of a new gate agree."""
    return candidate.measurements >= _CONFIRMATIONS


def make_measurement(gate: int, markers: list) -> GateMeasurement:
    """Returns the measurement of Detections of one gate, which has that index in the belief."""
    return GateMeasurement(
        gate,
        np.array([marker.id for marker in markers]),
        np.array([marker.corners.ravel() for marker in markers], float),
        np.array([marker.corner_sigma**2 for marker in markers]),
    )


def _seeds(belief: Belief, marker: Detection, camera: Camera) -> list[np.ndarray]:
    """Returns where the pose of one marker puts its gate, and the other pose of that picture.

    A square has two poses in a picture, whose normals are mirrored at the line of sight
    (Collins and Bartoli, "Infinitesimal plane-based pose estimation", 2014).
    """
    X_CM = marker.X_CM.GetAsMatrix34()
    R_WB, position = body_axes(belief), as_navigation(belief.navigation).position
    R_WC, p_WC = product(R_WB, camera.R_CB.T), position + rotate(R_WB, camera.p_IC)
    ray, normal = rotate(R_WC, X_CM[:, 3]), rotate(R_WC, X_CM[:, 2])
    sight, face = math.atan2(ray[1], ray[0]), math.atan2(normal[1], normal[0])
    seeds = []
    for outwards in (face, 2.0 * sight - face):
        heading = wrap_angle(outwards if facing(marker.id) > 0.0 else outwards + math.pi)
        gate = gate_vector(GateState(np.zeros(3), heading, GATE_SPACING))
        gate[AT_GATE.p_WG] = p_WC + ray - board_position(gate, marker.id)[0]
        seeds.append(gate)
    return seeds


def _with_gate(belief: Belief, gate: np.ndarray) -> Belief:
    """Returns the belief with one more gate, of which next to nothing is known."""
    size = len(belief.covariance)
    covariance = np.zeros((size + GATE, size + GATE))
    covariance[:size, :size] = belief.covariance
    covariance[size:, size:] = np.diag(_UNKNOWN)
    gates = np.concatenate((belief.gates, gate.reshape((1, GATE))))
    return Belief(belief.navigation.copy(), gates, covariance)


def _as_before(fitted: Belief, belief: Belief) -> np.ndarray:
    """Returns the state of a fit's newest gate that stands before the drone of a belief, (5,).

    From there, the gate is where it is in the fit from the drone of the fit.
    """
    p_WG, heading, spacing = as_gate(fitted.gates[-1])
    turn = product(body_axes(belief), body_axes(fitted).T)
    offset = p_WG - as_navigation(fitted.navigation).position
    p_WG = as_navigation(belief.navigation).position + rotate(turn, offset)
    normal = rotate(turn, (math.cos(heading), math.sin(heading), 0.0))
    return gate_vector(GateState(p_WG, math.atan2(normal[1], normal[0]), spacing))


def _fitted(
    belief: Belief, seed: np.ndarray, measurement: GateMeasurement, camera: Camera
) -> tuple[Belief, Innovation]:
    """Returns the belief with a gate that was fitted to a measurement, and how well it fits.

    From the wrong one of two mirrored poses the attitude goes many degrees astray and comes back.
    The heading of the world, which no corner shows, does not come back with it, as each
    iteration carries it on. So the fit is done again from the drone as it was, and a last time
    for the one in hundreds that goes astray twice.
    """
    result, fit = updated(_with_gate(belief, seed), measurement, camera, 1.0, _ITERATIONS)
    for _ in range(_FITS - 1):
        again = _with_gate(belief, _as_before(result, belief))
        result, fit = updated(again, measurement, camera, 1.0, _ITERATIONS)
    return result, fit


def new_gate(belief: Belief, markers: list, camera: Camera) -> Belief | None:
    """Returns the belief with a gate that is not yet in it, None if the measurement is ambiguous.

    It is the Gauss-Newton fit of gate, attitude and all else to the corners, from each of the
    two headings that a planar marker may have.

    Args:
        belief: of the filter.
        markers: Detections of the gate's markers in one picture.
        camera: see Camera.
    """
    measurement = make_measurement(len(belief.gates), markers)
    fits = [
        _fitted(belief, seed, measurement, camera) for seed in _seeds(belief, markers[0], camera)
    ]
    (best, fit), (other, other_fit) = sorted(fits, key=lambda each: each[1].cost)
    turn = wrap_angle(as_gate(other.gates[-1]).heading - as_gate(best.gates[-1]).heading)
    is_clear = abs(turn) <= _SAME_HEADING or other_fit.cost - fit.cost > _LEAST_ADVANTAGE
    if not (fit.cost < _MOST_COST and is_clear):
        return None
    variances = as_gate(np.diag(relative_covariance(best, len(best.gates) - 1)))
    return best if variances.heading < _MOST_HEADING_SIGMA**2 else None
