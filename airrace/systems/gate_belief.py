"""Where one gate stands, and how sure that is: an information filter on a rigid body."""

import dataclasses as dc
import math

import numpy as np

from airrace.immutable import Immutable, read_only
from airrace.systems.marker_pose import GATE_SPACING
from airrace.systems.sighting import Sighting
from airrace.track import BOARD_OFFSET

# The pose of a gate: x, y, z of its midpoint at the boards' height (m), heading
# (rad), spacing of its pylons (m). Pylons stand upright, so no more is free.
X, Y, Z, HEADING, SPACING = range(5)
_SPACING_SIGMA = 1.0  # m, of gates that are not as the rules say
# A gate is as the rules say if it looks so to this, once that is known to this.
_LIKE_THE_RULES, _CLEARLY = 0.2, 0.15  # m
_RULES_SIGMA = 0.005  # m, of the spacing of such a gate
CHI_SQUARE_3 = 16.27  # 99.9 % of three normal errors lie within
_CHI_SQUARE_4 = 18.47  # and of four: nine equations of two sightings less five unknowns
_HEADING_SIGMAS = 3.0  # beyond these, a normal is not believed
_FLOOR = 0.03  # m, of a board's place in tests: errors that sightings share
# What is known fades with time, so that the newest laps always count: variances.
_FADING = np.array([2e-4, 2e-4, 2e-4, 2e-5, 0.0]) ** 2  # m^2/s, rad^2/s
_ITERATIONS, _CLOSE_ENOUGH = 8, 1e-4  # m, rad
_I = np.eye(3)
_LEAST_HEADING_INFORMATION = 0.1  # 1/rad^2


@dc.dataclass(frozen=True, eq=False)
class GateBelief(Immutable):
    """The pose of a gate.

    Attributes:
        pose: most likely one, (5,).
        covariance: of its error, (5, 5).
        time: of the newest sighting in it (s).
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

    def board(self, id: int) -> tuple[np.ndarray, np.ndarray]:
        """Returns the position of a board's centre, (3,), and its covariance, (3, 3)."""
        p_WM, J = board_position(self.pose, id)
        return p_WM, J @ self.covariance @ J.T

    def distance(self, sighting: Sighting) -> float:
        """Returns the square of the Mahalanobis distance of a sighting."""
        p_WM, covariance = self.board(sighting.id)
        error = sighting.p_WM - p_WM
        return float(error @ np.linalg.solve(
            covariance + sighting.covariance + _FLOOR**2 * _I, error
        ))

    def updated(self, sighting: Sighting, weight: float) -> "GateBelief":
        """Returns the belief with one more sighting (extended Kalman filter).

        Args:
            sighting: of one of the gate's boards.
            weight: how much of its information is new, 0 to 1.
        """
        faded = self.covariance + np.diag(_FADING * max(sighting.time - self.time, 0.0))
        information = np.linalg.inv(faded)
        gain, error = _information(self.pose, sighting)
        return _improved(self, information, weight * gain, weight * error,
                         time=max(self.time, sighting.time))

    def knowing_the_rules(self) -> "GateBelief":
        """Returns the belief with the spacing that the rules say, if it looks so.

        Markers are seen in the right direction much more than in the right
        distance: a known spacing makes one distance of two directions.
        """
        excess = self.pose[SPACING] - GATE_SPACING
        if (self.by_the_rules or abs(excess) > _LIKE_THE_RULES
                or self.covariance[SPACING, SPACING] > _CLEARLY**2):
            return self
        gain, error = np.zeros((5, 5)), np.zeros(5)
        gain[SPACING, SPACING] = _RULES_SIGMA**-2
        error[SPACING] = -excess * _RULES_SIGMA**-2
        return _improved(self, np.linalg.inv(self.covariance), gain, error, by_the_rules=True)


def _improved(belief: GateBelief, information, gain, error, **changes) -> GateBelief:
    """Returns a belief with what is new.

    Args:
        belief: before.
        information: inverse of its covariance, (5, 5).
        gain, error: J^T R^-1 J, (5, 5), and J^T R^-1 error, (5,), of what is new.
        changes: of other attributes.
    """
    covariance = np.linalg.inv(information + gain)
    return dc.replace(
        belief,
        pose=read_only(belief.pose + covariance @ error),
        covariance=read_only((covariance + covariance.T) / 2),
        **changes,
    )


def board_position(pose, id: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns where a board's centre is on a gate, and its derivative by the pose.

    Args:
        pose: of the gate, (5,).
        id: of the marker: 4n left front, 4n+1 left back, 4n+2 right front,
            4n+3 right back.

    Returns:
        (p_WM, J): (3,), (3, 5).
    """
    half = 0.5 if id & 2 else -0.5  # right, left
    side, out = half * pose[SPACING], BOARD_OFFSET * facing(id)
    c, s = math.cos(pose[HEADING]), math.sin(pose[HEADING])
    p_WM = np.array([pose[X] + out * c + side * s, pose[Y] + out * s - side * c, pose[Z]])
    J = np.zeros((3, 5))
    J[:, :3] = _I
    J[:2, HEADING] = [-out * s + side * c, out * c + side * s]
    J[:2, SPACING] = [half * s, -half * c]
    return p_WM, J


def facing(id: int) -> int:
    """Returns 1 if a board faces in the direction of flight, -1 if against it."""
    return 1 if id & 1 else -1


def fit(sightings, known: GateBelief | None = None) -> GateBelief:
    """Returns the pose that fits some sightings best (Gauss-Newton).

    Args:
        sightings: of boards of one gate, at least one. The first guess is that
            the last of them is right.
        known: what was believed of the gate elsewhere: it may move, but is
            still as wide.
    """
    by_the_rules = known is not None and known.by_the_rules
    spacing = known.pose[SPACING] if by_the_rules else GATE_SPACING
    last = sightings[-1]
    pose = np.array([0.0, 0.0, 0.0, _heading(last), spacing])
    pose[:3] = last.p_WM - board_position(pose, last.id)[0]
    prior = np.diag([0.0] * 4 + [(_RULES_SIGMA if by_the_rules else _SPACING_SIGMA) ** -2])
    # Normals that contradict each other may all be disbelieved.
    damping = np.diag([0.0, 0.0, 0.0, _LEAST_HEADING_INFORMATION, 0.0])
    for _ in range(_ITERATIONS):
        gains, errors = zip(*(_information(pose, sighting) for sighting in sightings))
        covariance = np.linalg.inv(prior + damping + np.sum(gains, axis=0))
        expected = np.array([0.0, 0.0, 0.0, 0.0, spacing - pose[SPACING]])
        step = covariance @ (np.sum(errors, axis=0) + prior @ expected)
        pose = pose + step
        if np.abs(step).max() < _CLOSE_ENOUGH:
            break
    return GateBelief(
        read_only(pose), read_only((covariance + covariance.T) / 2), last.time, by_the_rules
    )


def agreement(a: Sighting, b: Sighting, known: GateBelief | None = None) -> GateBelief | None:
    """Returns the gate that two sightings of different images agree on, None if they do not.

    Args:
        a, b: of boards of one gate.
        known: see fit().
    """
    if a.time == b.time or _contradict(a, b):
        return None
    belief = fit((a, b), known)
    misfit = ((belief.pose[SPACING] - GATE_SPACING) / _SPACING_SIGMA) ** 2
    for sighting in (a, b):
        error = sighting.p_WM - board_position(belief.pose, sighting.id)[0]
        misfit += error @ np.linalg.solve(sighting.covariance + _FLOOR**2 * _I, error)
        turn = _turn_between(_heading(sighting), belief.pose[HEADING])
        misfit += turn**2 / sighting.heading_variance
    return belief if misfit <= _CHI_SQUARE_4 else None


def _contradict(a: Sighting, b: Sighting) -> bool:
    """Whether no gate can be where two sightings are: what a fit would find, but faster.

    All boards are at the same height, and one board is in one place.
    """
    turn = _turn_between(_heading(a), _heading(b))
    axes = slice(0, 3) if a.id == b.id else slice(2, 3)
    error = (a.p_WM - b.p_WM)[axes]
    covariance = (a.covariance + b.covariance + 2 * _FLOOR**2 * _I)[axes, axes]
    misfit = turn**2 / (a.heading_variance + b.heading_variance)
    return bool(misfit + error @ np.linalg.solve(covariance, error) > _CHI_SQUARE_4)


def _turn_between(heading, other) -> float:
    """Returns the first heading less the other (rad), in [-pi, pi)."""
    return (heading - other + np.pi) % (2 * np.pi) - np.pi


def _heading(sighting: Sighting) -> float:
    """Returns the gate's heading by the normal of a board (rad)."""
    x, y, _ = (facing(sighting.id) * sighting.normal).tolist()
    return math.atan2(y, x)


def _information(pose, sighting: Sighting) -> tuple[np.ndarray, np.ndarray]:
    """Returns what a sighting says about a pose: J^T R^-1 J, (5, 5), and J^T R^-1 error, (5,)."""
    p_WM, J = board_position(pose, sighting.id)
    weighted = np.linalg.solve(sighting.covariance, J).T
    information = weighted @ J
    error = weighted @ (sighting.p_WM - p_WM)
    turn = _turn_between(_heading(sighting), pose[HEADING])
    # Of two poses that a square admits, the detector may have taken the wrong one.
    if turn**2 < _HEADING_SIGMAS**2 * sighting.heading_variance:
        information[HEADING, HEADING] += 1 / sighting.heading_variance
        error[HEADING] += turn / sighting.heading_variance
    return information, error
