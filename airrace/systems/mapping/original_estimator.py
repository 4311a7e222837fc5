"""The estimator of the Student AirRace paper: mean and variance of each marker by itself."""

import dataclasses as dc
from collections import Counter
from typing import Any, NamedTuple

import numpy as np

from airrace.common.immutable import Immutable, read_only
from airrace.systems.mapping.observation import INVALID, OFF_MAP, Observation
from airrace.track import BOARD_OFFSET, PYLON_BASE_RADIUS
from airrace.track.gate_map import GateEstimate, GateMap, MarkerEstimate


class PositionEstimate(NamedTuple):
    """What some positions of a marker say together."""

    mean: np.ndarray  #: of those that are no outliers, (3,) m
    variance: np.ndarray  #: of their coordinates, as of a population, (3,) m^2
    outliers: int  #: number of the others


@dc.dataclass(frozen=True, eq=False)
class MarkerStatistics(Immutable):
    """All that is known of one marker; a new one for every observation."""

    #: P_WM of every observation, oldest first, (n, 3) m; none is ever deleted.
    positions: np.ndarray
    normal: np.ndarray  #: sum of their unit vectors out of the board's face, (3,)
    estimate: PositionEstimate  #: what the positions say
    invalid: int = 0  #: number of observations that said nothing

    @property
    def count(self) -> int:
        """Number of positions."""
        return len(self.positions)

    def updated(
        self, p_WM: np.ndarray, normal: np.ndarray, outlier_sigma: float
    ) -> "MarkerStatistics":
        """Returns the statistics with one more observation.

        Args:
            p_WM: position of the board's centre, (3,) m; invalid if it is (0, 0, 0).
            normal: unit vector out of the board's face, (3,).
            outlier_sigma: see estimate_position().
        """
        if not p_WM.any():
            return dc.replace(self, invalid=self.invalid + 1)
        positions = np.concatenate((self.positions, p_WM[None]))
        positions.setflags(write=False)
        return MarkerStatistics(
            positions=positions,
            normal=read_only(self.normal + normal),
            estimate=estimate_position(positions, outlier_sigma),
            invalid=self.invalid,
        )


_ZERO = read_only(np.zeros(3))
EMPTY = MarkerStatistics(read_only(np.zeros((0, 3))), _ZERO, PositionEstimate(_ZERO, _ZERO, 0))


def estimate_position(positions: np.ndarray, outlier_sigma: float) -> PositionEstimate:
    """Returns what positions of a marker say together.

    Section III of the Student AirRace paper, as its mapping service computed it. With mean m
    and standard deviation s = sqrt(sum (x - m)^2 / n) of each coordinate of all n positions, a
    position is an outlier if a coordinate has |x - m| >= 3 s. Mean and variance of the others
    are the estimate. As no x is farther off than s sqrt(n - 1), the first outlier is one of ten.

    Args: positions: (n, 3) m, n at least 1. outlier_sigma: the 3.
    """
    mean, variance = _moments(positions)
    off = np.abs(positions - mean)
    # Where all positions are equal, s is 0: none is off, though 0 >= 3 s is true.
    is_outlier = ((off > 0.0) & (off >= outlier_sigma * np.sqrt(variance))).any(axis=1)
    outliers = int(is_outlier.sum())
    # With less than sqrt(3) standard deviations all may be outliers. The mean of no positions
    # does not exist, so that of all of them stands.
    if outliers == len(positions):
        outliers = 0
    elif outliers:
        mean, variance = _moments(positions[~is_outlier])
    return PositionEstimate(read_only(mean), read_only(variance), outliers)


def _moments(positions):
    """Returns mean and population variance of positions, (3,) each."""
    mean = positions.sum(axis=0) / len(positions)
    return mean, np.square(positions - mean).sum(axis=0) / len(positions)


class OriginalEstimator:
    """Section III of the Student AirRace paper.

    The variance of a MarkerEstimate is that of the observations that count, and an outlier is
    one that is left out of the mean now: all are tested again whenever one is added.
    """

    def __init__(self, *, outlier_sigma: float, min_observations: int):
        """Constructs the estimator.

        Args:
            outlier_sigma: see estimate_position().
            min_observations: of both front markers, outliers included, before a gate is in
                the map.
        """
        self._outlier_sigma = outlier_sigma
        self._min_observations = min_observations

    def updated(self, statistics: dict, observation: Observation) -> dict:
        """Returns marker ID to MarkerStatistics after one more observation."""
        marker = statistics.get(observation.id, EMPTY).updated(
            observation.p_WM, observation.normal, self._outlier_sigma
        )
        return statistics | {observation.id: marker}

    def make_map(self, statistics: dict, **counters: Any) -> GateMap:
        """Returns the map; counters: the attributes of GateMap that count."""
        refused = Counter(counters.pop("refused", {}))
        for s in statistics.values():
            refused.update({OFF_MAP: s.estimate.outliers, INVALID: s.invalid})
        markers = {
            id: MarkerEstimate(
                id=id,
                count=s.count - s.estimate.outliers,
                outliers=s.estimate.outliers,
                p_WM=s.estimate.mean,
                variance=s.estimate.variance,
                normal=read_only(s.normal / max(np.linalg.norm(s.normal), 1e-9)),
            )
            for id, s in sorted(statistics.items())
            if s.count
        }
        known = {id for id, s in statistics.items() if s.count >= self._min_observations}
        gates = (
            make_gate(id // 4, markers[id].p_WM, markers[id + 2].p_WM)
            for id in sorted(known)
            if id % 4 == 0 and id + 2 in known
        )
        return GateMap(
            markers=tuple(markers.values()),
            gates=tuple(gate for gate in gates if gate is not None),
            refused=dict(sorted((+refused).items())),
            **counters,
        )


def make_gate(number: int, p_WL: np.ndarray, p_WR: np.ndarray) -> GateEstimate | None:
    """Returns the gate between two front markers, None if it is impossible.

    Args: number: of the gate. p_WL, p_WR: centres of the left and the right front board, (3,).
    """
    right = (p_WR - p_WL)[:2]
    if np.linalg.norm(right) < 2 * PYLON_BASE_RADIUS:
        return None
    heading = float(np.arctan2(right[0], -right[1]))
    forward = np.array([np.cos(heading), np.sin(heading), 0.0])
    p_WG = (p_WL + p_WR) / 2 + BOARD_OFFSET * forward
    return GateEstimate(
        number=number, p_WG=read_only(p_WG), heading=heading, spacing=float(np.linalg.norm(right))
    )
