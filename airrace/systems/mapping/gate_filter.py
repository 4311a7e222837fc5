"""A Kalman filter on the pose of one gate: a rigid body with four boards as landmarks.

The state is the vector of a GateState, (5,). Pylons stand upright, so a gate has no other degree of
freedom.
"""

import dataclasses as dc
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from airrace.common.immutable import Immutable, read_only
from airrace.common.jit import compiled
from airrace.common.packing import Packing
from airrace.math.angles import wrap_angle
from airrace.math.small_matrices import (
    apply,
    cholesky,
    inverse,
    product,
    propagated,
    solve_cholesky,
)
from airrace.math.vec3 import dot
from airrace.systems.mapping.observation import Observation
from airrace.systems.perception.marker_pose import GATE_SPACING
from airrace.track import BOARD_OFFSET


class GateState(NamedTuple):
    """Pose and size of a gate."""

    p_WG: np.ndarray  #: midpoint at the boards' height (m), (3,)
    heading: float  #: direction of flight (rad)
    spacing: float  #: between the pylons' axes (m)


_PACKING = Packing(GateState, p_WG=3)
as_gate, gate_vector, GATE = _PACKING.parts, _PACKING.vector, _PACKING.size
AT_GATE = _PACKING.at  # where each begins and ends

CHI_SQUARE_3 = 16.27  # 99.9 % of the squared Mahalanobis distances of a position
_CHI_SQUARE_4 = 18.47  # and of two observations of a gate: nine equations, five unknowns
_POSITION_SIGMA = 0.03  # m, added in tests: errors that observations share
_HEADING_SIGMAS = 3.0  # a normal that is farther off is not used
# Random walk of the state, so that the newest laps always count: variances.
_PROCESS_NOISE = gate_vector(GateState(np.full(3, 2e-4), 2e-5, 0.0)) ** 2  # m^2/s, rad^2/s
_SPACING_SIGMA = 1.0  # m, of gates in general
# A gate has the spacing of the rules if its estimate is so near, and so certain.
_SPACING_TOLERANCE, _SPACING_CERTAINTY = 0.2, 0.15  # m
RULES_SIGMA = 0.005  # m, of the spacing of such a gate
_HEADING_INFORMATION = 0.1  # 1/rad^2, in a fit, where all normals may be left out
_ITERATIONS, _TOLERANCE = 8, 1e-4  # m, rad
_NONE = np.zeros(3)


@dc.dataclass(frozen=True, eq=False)
class GateFilter(Immutable):
    """The estimate of a gate's pose; a new one for every observation."""

    state: np.ndarray  #: see above, (5,)
    covariance: np.ndarray  #: of its error, (5, 5)
    time: float  #: of the newest observation in it (s)
    obeys_rules: bool = False  #: whether the spacing that the rules say is in it, too

    @property
    def heading(self) -> float:
        """Direction of flight (rad)."""
        return float(as_gate(self.state).heading)

    @property
    def spacing(self) -> float:
        """Between the pylons' axes (m)."""
        return float(as_gate(self.state).spacing)

    @property
    def heading_variance(self) -> float:
        """Of the heading (rad^2)."""
        return float(as_gate(np.diag(self.covariance)).heading)

    def squared_distance(self, observation: Observation) -> float:
        """Returns the squared Mahalanobis distance of an observation, nu^T S^-1 nu."""
        p_WM, H = board_position(self.state, observation.id)
        S = propagated(H, self.covariance) + observation.covariance
        return _normalized_square(observation.p_WM - p_WM, S)

    def updated(self, observation: Observation, weight: float) -> "GateFilter":
        """Returns the estimate with one more observation.

        The measurement update of the extended information filter, with w for the weight::

            P+ = (P^-1 + w H^T R^-1 H)^-1,    x+ = x + P+ w H^T R^-1 nu

        See Thrun, Burgard and Fox, "Probabilistic Robotics", 2005, section 3.5.

        Args:
            observation: of one of the gate's boards.
            weight: share of its information that is new, 0 to 1.
        """
        dt = max(observation.time - self.time, 0.0)
        predicted = self.covariance + np.diag(dt * _PROCESS_NOISE)
        matrix, vector = _information(self.state, observation)
        covariance = inverse(inverse(predicted) + weight * matrix)
        state = self.state + apply(covariance, weight * vector)
        time = max(self.time, observation.time)
        return GateFilter(read_only(state), read_only(covariance), time, self.obeys_rules)

    def with_rules(self) -> "GateFilter":
        """Returns the estimate with the spacing that the rules say, if it seems to be that.

        Markers are seen in the right direction much more exactly than at the right
        distance. Two directions and a known spacing tell the distance.
        """
        error, correlated = GATE_SPACING - self.spacing, self.covariance[AT_GATE.spacing]
        variance = as_gate(correlated).spacing
        if self.obeys_rules or not has_spacing_of_rules(self.spacing, variance):
            return self
        gain = correlated / (variance + RULES_SIGMA**2)
        state = self.state + gain * error
        covariance = self.covariance - np.outer(gain, correlated)
        covariance = (covariance + covariance.T) / 2
        return GateFilter(read_only(state), read_only(covariance), self.time, obeys_rules=True)

    def is_certain(self, sigma: float) -> bool:
        """Whether the position has a standard deviation below sigma (m) in every direction."""
        rest = sigma**2 * np.eye(3) - self.covariance[AT_GATE.p_WG, AT_GATE.p_WG]
        return not math.isnan(cholesky(rest)[2, 2])  # it is positive definite


def has_spacing_of_rules(spacing: float, variance: float) -> bool:
    """Whether a gate has the spacing of the rules: it is nearly that, and known well.

    Args: spacing: estimated (m). variance: of its error (m^2).
    """
    return abs(GATE_SPACING - spacing) <= _SPACING_TOLERANCE and variance <= _SPACING_CERTAINTY**2


def least_observed(counts: dict) -> int:
    """Returns the observations of the pylon that has fewer; counts: by marker ID."""
    return min(sum(n for id, n in counts.items() if id & 2 == pylon) for pylon in (0, 2))


def fit(observations: Sequence[Observation], before: GateFilter | None = None) -> GateFilter:
    """Returns the pose that fits some observations best (Gauss-Newton).

    Args:
        observations: of boards of one gate, at least one. The iteration starts where the
            last of them alone puts the gate.
        before: the estimate of the gate before it moved: its spacing is still the same.
    """
    spacing, sigma, obeys_rules = GATE_SPACING, _SPACING_SIGMA, False
    if before is not None and before.obeys_rules:
        spacing, sigma, obeys_rules = before.spacing, RULES_SIGMA, True
    last = observations[-1]
    state = gate_vector(GateState(_NONE, gate_heading(last), spacing))
    state[AT_GATE.p_WG] = last.p_WM - board_position(state, last.id)[0]
    prior = np.diag(gate_vector(GateState(_NONE, 0.0, sigma**-2)))
    damping = np.diag(gate_vector(GateState(_NONE, _HEADING_INFORMATION, 0.0)))
    for _ in range(_ITERATIONS):
        matrices, vectors = zip(*(_information(read_only(state), o) for o in observations))
        covariance = np.linalg.inv(prior + damping + np.sum(matrices, axis=0))
        to_prior = gate_vector(GateState(_NONE, 0.0, spacing - as_gate(state).spacing))
        step = covariance @ (np.sum(vectors, axis=0) + prior @ to_prior)
        state = state + step
        if np.abs(step).max() < _TOLERANCE:
            break
    covariance = (covariance + covariance.T) / 2
    return GateFilter(read_only(state), read_only(covariance), last.time, obeys_rules)


def fit_pair(a: Observation, b: Observation, before: GateFilter | None = None) -> GateFilter | None:
    """Returns the gate that two observations agree on, None if they do not (chi-square test).

    Args:
        a, b: of boards of one gate. Two of the same image never agree: they share the error
            of the drone's pose.
        before: see fit().
    """
    if a.time == b.time:
        return None
    fitted = fit((a, b), before)
    misfit = ((fitted.spacing - GATE_SPACING) / _SPACING_SIGMA) ** 2
    for observation in (a, b):
        innovation = observation.p_WM - board_position(fitted.state, observation.id)[0]
        misfit += _normalized_square(innovation, observation.covariance)
        turn = wrap_angle(gate_heading(observation) - fitted.heading)
        misfit += turn**2 / observation.heading_variance
    return fitted if misfit <= _CHI_SQUARE_4 else None


@compiled
def facing(id: int) -> float:
    """Returns 1 if a board faces in the direction of flight, -1 if against it."""
    return 1.0 if id & 1 else -1.0


@compiled
def gate_heading(observation: Observation) -> float:
    """Returns the gate's heading by the normal of one board (rad)."""
    x, y, _ = observation.normal
    return math.atan2(facing(observation.id) * y, facing(observation.id) * x)


@compiled
def board_position(state: np.ndarray, id: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns the position of a board's centre, and its derivative by the gate's state.

    Args:
        state: of the gate, (5,).
        id: of the marker: 4n left front, 4n+1 left back, 4n+2 right front,
            4n+3 right back.

    Returns: (p_WM, H): (3,), (3, 5).
    """
    (x, y, z), heading, spacing = as_gate(state)
    half = 0.5 if id & 2 else -0.5  # right, left
    side, out = half * spacing, BOARD_OFFSET * facing(id)
    c, s = math.cos(heading), math.sin(heading)
    p_WM = np.array((x + out * c + side * s, y + out * s - side * c, z))
    H = np.array(
        (
            (1.0, 0.0, 0.0, -out * s + side * c, half * s),
            (0.0, 1.0, 0.0, out * c + side * s, -half * c),
            (0.0, 0.0, 1.0, 0.0, 0.0),
        )
    )
    return p_WM, H


@compiled
def boards(state: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Returns position, its variances, and normal of a gate's boards by ID, (4, 3, 3)."""
    result = np.zeros((4, 3, 3))
    for id in range(4):
        p_WM, H = board_position(state, id)
        result[id, 0], result[id, 1] = p_WM, np.diag(propagated(H, covariance))
        heading = as_gate(state).heading
        result[id, 2, :2] = facing(id) * math.cos(heading), facing(id) * math.sin(heading)
    return result


@compiled
def is_behind(state: np.ndarray, observation: Observation, reach: float) -> bool:
    """Whether a camera was on the wrong side of the face of the board that it saw.

    Args:
        state: of the gate, (5,).
        observation: of one of its boards.
        reach: greatest distance between board and observation (m), for that to be certain.
    """
    p_WM, _ = board_position(state, observation.id)
    x, y, _ = observation.p_WC - p_WM
    heading = as_gate(state).heading
    front = facing(observation.id) * (x * math.cos(heading) + y * math.sin(heading))
    return np.linalg.norm(observation.p_WM - p_WM) < reach and front < 0.0


@compiled
def _normalized_square(error, covariance):
    """Returns e^T (C + sigma^2 I)^-1 e for a position's error (m), with its shared part."""
    C = covariance + _POSITION_SIGMA**2 * np.eye(3)
    return dot(error, solve_cholesky(cholesky(C), error))


@compiled
def _information(state, observation):
    """Returns what an observation says about a gate: H^T R^-1 H, (5, 5), and H^T R^-1 nu, (5,).

    H is the derivative of the measurement by the state, R the measurement's covariance and
    nu the innovation. The measurement is the board's position, and the gate's heading by
    the board's normal.
    """
    p_WM, H = board_position(state, observation.id)
    weighted = product(H.T, inverse(observation.covariance))
    matrix, vector = product(weighted, H), apply(weighted, observation.p_WM - p_WM)
    turn = wrap_angle(gate_heading(observation) - as_gate(state).heading)
    variance = observation.heading_variance
    # Of the two poses that a square admits, the detector may have taken the wrong one.
    if turn**2 < _HEADING_SIGMAS**2 * variance:
        matrix[AT_GATE.heading, AT_GATE.heading] += 1 / variance
        vector[AT_GATE.heading] += turn / variance
    return matrix, vector
