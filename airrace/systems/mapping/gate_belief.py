"""Where one gate stands, and how sure that is; how it is filtered is in gate_filter.py."""

import dataclasses as dc
import math

import numpy as np

from airrace.common.immutable import Immutable, read_only
from airrace.systems.mapping import gate_filter as gf
from airrace.systems.mapping.gate_filter import HEADING, SPACING, facing
from airrace.systems.mapping.observation import Observation
from airrace.systems.perception.marker_pose import GATE_SPACING

_SPACING_SIGMA = 1.0  # m, of gates that are not as the rules say
# A gate is as the rules say if it looks so to this, once that is known to this.
_LIKE_THE_RULES, _CLEARLY = 0.2, 0.15  # m
_RULES_SIGMA = 0.005  # m, of the spacing of such a gate
CHI_SQUARE_3 = 16.27  # 99.9 % of three normal errors lie within
_CHI_SQUARE_4 = 18.47  # and of four: nine equations of two observations less five unknowns
_ITERATIONS, _CLOSE_ENOUGH = 8, 1e-4  # m, rad
_LEAST_HEADING_INFORMATION = 0.1  # 1/rad^2


@dc.dataclass(frozen=True, eq=False)
class GateBelief(Immutable):
    """The pose of a gate.

    Attributes:
        pose: most likely one, (5,).
        covariance: of its error, (5, 5).
        time: of the newest observation in it (s).
        by_the_rules: whether the spacing that the rules say is in it, too.
    """

    pose: np.ndarray
    covariance: np.ndarray
    time: float
    by_the_rules: bool = False

    @property
    def forward(self) -> np.ndarray:
        """Unit vector of flight through the gate, (3,)."""
        return np.array([np.cos(self.pose[HEADING]), np.sin(self.pose[HEADING]), 0.0])

    def distance(self, observation: Observation) -> float:
        """Returns the square of the Mahalanobis distance of an observation."""
        return gf.squared_distance(
            self.pose, self.covariance, observation.id, observation.p_WM, observation.covariance
        )

    def updated(self, observation: Observation, weight: float) -> "GateBelief":
        """Returns the belief with one more observation.

        Args:
            observation: of one of the gate's boards.
            weight: how much of its information is new, 0 to 1.
        """
        pose, covariance = gf.updated(
            self.pose, self.covariance, observation.time - self.time, weight, *_content(observation)
        )
        return GateBelief(
            read_only(pose),
            read_only(covariance),
            max(self.time, observation.time),
            self.by_the_rules,
        )

    def knowing_the_rules(self) -> "GateBelief":
        """Returns the belief with the spacing that the rules say, if it looks so.

        Markers are seen in the right direction much more than in the right
        distance: a known spacing makes one distance of two directions.
        """
        excess = self.pose[SPACING] - GATE_SPACING
        if (
            self.by_the_rules
            or abs(excess) > _LIKE_THE_RULES
            or self.covariance[SPACING, SPACING] > _CLEARLY**2
        ):
            return self
        gain, error = np.zeros((5, 5)), np.zeros(5)
        gain[SPACING, SPACING] = _RULES_SIGMA**-2
        error[SPACING] = -excess * _RULES_SIGMA**-2
        pose, covariance = gf.improved(self.pose, self.covariance.copy(), gain, error)
        return GateBelief(read_only(pose), read_only(covariance), self.time, by_the_rules=True)


def fit(observations, known: GateBelief | None = None) -> GateBelief:
    """Returns the pose that fits some observations best (Gauss-Newton).

    Args:
        observations: of boards of one gate, at least one. The first guess is that
            the last of them is right.
        known: what was believed of the gate elsewhere: it may move, but is
            still as wide.
    """
    by_the_rules = known is not None and known.by_the_rules
    spacing = known.pose[SPACING] if by_the_rules else GATE_SPACING
    last = observations[-1]
    # Read-only as in a belief: another type would be compiled once more.
    pose = read_only([0.0, 0.0, 0.0, _heading(last), spacing])
    pose = read_only([*(last.p_WM - gf.board_position(pose, last.id)[0]), *pose[3:]])
    prior = np.diag([0.0] * 4 + [(_RULES_SIGMA if by_the_rules else _SPACING_SIGMA) ** -2])
    # Normals that contradict each other may all be disbelieved.
    damping = np.diag([0.0, 0.0, 0.0, _LEAST_HEADING_INFORMATION, 0.0])
    for _ in range(_ITERATIONS):
        gains, errors = zip(
            *(gf.information(pose, *_content(observation)) for observation in observations)
        )
        covariance = np.linalg.inv(prior + damping + np.sum(gains, axis=0))
        expected = np.array([0.0, 0.0, 0.0, 0.0, spacing - pose[SPACING]])
        step = covariance @ (np.sum(errors, axis=0) + prior @ expected)
        pose = read_only(pose + step)
        if np.abs(step).max() < _CLOSE_ENOUGH:
            break
    return GateBelief(pose, read_only((covariance + covariance.T) / 2), last.time, by_the_rules)


def agreement(a: Observation, b: Observation, known: GateBelief | None = None) -> GateBelief | None:
    """Returns the gate that two observations of different images agree on, None if they do not.

    Args:
        a, b: of boards of one gate.
        known: see fit().
    """
    if a.time == b.time or _contradict(a, b):
        return None
    belief = fit((a, b), known)
    misfit = ((belief.pose[SPACING] - GATE_SPACING) / _SPACING_SIGMA) ** 2
    for observation in (a, b):
        error = observation.p_WM - gf.board_position(belief.pose, observation.id)[0]
        misfit += gf.weighted_square(error, observation.covariance)
        turn = gf.turn_between(_heading(observation), belief.pose[HEADING])
        misfit += turn**2 / observation.heading_variance
    return belief if misfit <= _CHI_SQUARE_4 else None


def _contradict(a: Observation, b: Observation) -> bool:
    """Whether no gate can be where two observations are: what a fit would find, but faster.

    All boards are at the same height, and one board is in one place.
    """
    turn = gf.turn_between(_heading(a), _heading(b))
    axes = slice(0, 3) if a.id == b.id else slice(2, 3)
    error = (a.p_WM - b.p_WM)[axes]
    covariance = (a.covariance + b.covariance + 2 * gf.FLOOR**2 * np.eye(3))[axes, axes]
    misfit = turn**2 / (a.heading_variance + b.heading_variance)
    return bool(misfit + error @ np.linalg.solve(covariance, error) > _CHI_SQUARE_4)


def _heading(observation: Observation) -> float:
    """Returns the gate's heading by the normal of a board (rad)."""
    x, y, _ = (facing(observation.id) * observation.normal).tolist()
    return math.atan2(y, x)


def _content(observation: Observation) -> tuple:
    """Returns the arguments of gate_filter.information() beside the pose."""
    return (
        observation.id,
        observation.p_WM,
        observation.covariance,
        _heading(observation),
        observation.heading_variance,
    )
