"""The estimator of the Student AirRace report: mean and variance of each marker by itself."""

import dataclasses as dc
from collections import Counter
from typing import Any

import numpy as np

from airrace.common.immutable import Immutable, read_only
from airrace.systems.mapping.observation import OFF_MAP, Observation
from airrace.track import BOARD_OFFSET, PYLON_BASE_RADIUS
from airrace.track.gate_map import GateEstimate, GateMap, MarkerEstimate


@dc.dataclass(frozen=True, eq=False)
class MarkerStatistics(Immutable):
    """Running statistics of one marker (Welford 1962).

    Attributes:
        count, outliers: observations that count, and that were rejected.
        mean: of p_WM, (3,).
        squares: sum of squared deviations from the mean, (3,).
        normal: sum of the unit vectors out of the board's face, (3,).
    """

    count: int
    outliers: int
    mean: np.ndarray
    squares: np.ndarray
    normal: np.ndarray

    @property
    def variance(self) -> np.ndarray:
        """Sample variance of each coordinate, (3,)."""
        return self.squares / max(self.count - 1, 1)

    def updated(
        self, p_WM: np.ndarray, normal: np.ndarray, outlier_sigma: float, min_observations: int
    ) -> "MarkerStatistics":
        """Returns the statistics with one more observation.

        Section III of the Student AirRace report: an observation is an outlier,
        and does not count, if any coordinate deviates from the mean so far by
        more than three standard deviations.
        """
        deviation = p_WM - self.mean
        limit = outlier_sigma * np.sqrt(self.variance)
        if self.count >= min_observations and np.any(np.abs(deviation) > limit):
            return dc.replace(self, outliers=self.outliers + 1)
        mean = self.mean + deviation / (self.count + 1)
        return MarkerStatistics(
            count=self.count + 1,
            outliers=self.outliers,
            mean=mean,
            squares=self.squares + deviation * (p_WM - mean),
            normal=self.normal + normal,
        )


EMPTY = MarkerStatistics(0, 0, *(read_only(np.zeros(3)) for _ in range(3)))


class ReportEstimator:
    """Section III of the Student AirRace report.

    The variance of a MarkerEstimate is that of the observations that count.
    """

    def __init__(self, *, outlier_sigma: float, min_observations: int):
        """Constructs the estimator.

        Args:
            outlier_sigma: see MarkerStatistics.updated().
            min_observations: before observations can be outliers, and of both front
                markers before a gate is in the map.
        """
        self._outlier_sigma = outlier_sigma
        self._min_observations = min_observations

    def updated(self, statistics: dict, observation: Observation) -> dict:
        """Returns marker ID to MarkerStatistics after one more observation."""
        marker = statistics.get(observation.id, EMPTY).updated(
            observation.p_WM, observation.normal, self._outlier_sigma, self._min_observations
        )
        return statistics | {observation.id: marker}

    def make_map(self, statistics: dict, **counters: Any) -> GateMap:
        """Returns the map; counters: the attributes of GateMap that count."""
        refused = Counter(counters.pop("refused", {}))
        refused.update({OFF_MAP: sum(s.outliers for s in statistics.values())})
        markers = {
            id: MarkerEstimate(
                id=id,
                count=s.count,
                outliers=s.outliers,
                p_WM=read_only(s.mean),
                variance=read_only(s.variance),
                normal=read_only(s.normal / max(np.linalg.norm(s.normal), 1e-9)),
            )
            for id, s in sorted(statistics.items())
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

    Args:
        number: of the gate.
        p_WL, p_WR: centres of the left and the right front board, (3,).
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
