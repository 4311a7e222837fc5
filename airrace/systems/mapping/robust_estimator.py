"""The robust estimator: gates are rigid, observations differ in accuracy, and some are wrong.

Each gate has a track, which decides what becomes of an observation. A gate that has moved is
noticed here, see GateTrack.
"""

import dataclasses as dc
import functools
from collections import Counter
from collections.abc import Iterable
from typing import Any

import numpy as np

from airrace.common.immutable import Immutable, read_only
from airrace.math.angles import wrap_angle
from airrace.systems.mapping import gate_filter
from airrace.systems.mapping.gate_filter import CHI_SQUARE_3, GateFilter
from airrace.systems.mapping.observation import OFF_MAP, UNCONFIRMED, Observation
from airrace.systems.perception.detection_checks import FROM_BEHIND, JUMP
from airrace.track import PYLON_BASE_RADIUS
from airrace.track.gate_map import GateEstimate, GateMap, MarkerEstimate

_MOST_UNCONFIRMED = 8  # observations that a track keeps
_CORRELATION_TIME = 0.15  # s, for which the errors of one marker's observations stay the same
_JUMP_TIME = 0.5  # s, since the marker was where the map has it
_REACH = 3.0  # m, from a board to the other face of its pylon and a little more
_POSITION_SIGMA = 0.3  # m, of a gate's midpoint, before it is in the map
_HEADING_SIGMA = 0.2  # rad, of a heading that tells front from back


@dc.dataclass(frozen=True, eq=False)
class GateTrack(Immutable):
    """All that is known of one gate; a new one for every observation.

    An observation counts if it passes the gating test: its Mahalanobis distance from the
    estimate is small. Otherwise it is kept as unconfirmed. If two unconfirmed observations of
    different images agree with each other, the gate has moved, or the estimate was wrong: it
    starts again where they put the gate.
    """

    estimate: GateFilter | None = None  #: a GateFilter, None before two observations agreed
    #: Pairs of an observation that does not fit and the reason to refuse it, oldest first.
    unconfirmed: tuple = ()
    counts: dict = dc.field(default_factory=dict)  #: marker ID to how many observations count
    #: Marker ID to the time of the newest that counts (s).
    times: dict = dc.field(default_factory=dict)
    #: (marker ID, reason) to how many are refused for good.
    refused: dict = dc.field(default_factory=dict)
    was_certain: bool = False  #: whether the estimate was certain before the gate moved

    def updated(self, observation: Observation) -> "GateTrack":
        """Returns the track after one more observation of one of the gate's boards."""
        reason = UNCONFIRMED
        if self.estimate is not None:
            if _is_behind(self.estimate, observation):
                return self._refusing((observation, FROM_BEHIND))
            reason = JUMP if self._elapsed(observation) <= _JUMP_TIME else OFF_MAP
        if (after := self._accepting(observation)) is not None:
            return after
        unconfirmed = (*self.unconfirmed, (observation, reason))
        for other, _ in reversed(self.unconfirmed):
            estimate = gate_filter.fit_pair(other, observation, self.estimate)
            if estimate is not None:
                return self._restarted(estimate, unconfirmed, (other, observation))
        dropped, kept = unconfirmed[:-_MOST_UNCONFIRMED], unconfirmed[-_MOST_UNCONFIRMED:]
        return dc.replace(self, unconfirmed=kept)._refusing(*dropped)

    def is_known(self, min_observations: int) -> bool:
        """Whether the gate is known well enough to be in the map."""
        if self.estimate is None:
            return False
        return (
            gate_filter.least_observed(self.counts) >= min_observations
            and self.estimate.spacing > 2 * PYLON_BASE_RADIUS
            # A gate that moved stays in the map, even if it was hardly seen since.
            and (self.was_certain or self._is_certain())
        )

    def all_refused(self) -> Counter:
        """Returns how many observations, by marker ID and reason, do not count now."""
        return Counter(self.refused) + Counter((o.id, reason) for o, reason in self.unconfirmed)

    def _elapsed(self, observation: Observation) -> float:
        """Returns the time since the marker's last observation that counts (s)."""
        return observation.time - self.times.get(observation.id, -np.inf)

    def _is_certain(self) -> bool:
        return self.estimate is not None and self.estimate.is_certain(_POSITION_SIGMA)

    def _refusing(self, *pairs: tuple) -> "GateTrack":
        """Returns the track that refuses observations for good; pairs: as unconfirmed."""
        if not pairs:
            return self
        refused = Counter(self.refused) + Counter((o.id, reason) for o, reason in pairs)
        return dc.replace(self, refused=dict(refused))

    def _accepting(self, observation: Observation) -> "GateTrack | None":
        """Returns the track with an observation, None if that does not fit.

        One that fits refutes the unconfirmed ones of the same marker. Its errors are correlated
        with those of the observation before, and of two markers that were solved as one rigid
        body each counts half.
        """
        estimate = self.estimate
        if estimate is None or not estimate.squared_distance(observation) <= CHI_SQUARE_3:
            return None
        id, elapsed = observation.id, max(self._elapsed(observation), 0.0)
        weight = min(elapsed / _CORRELATION_TIME, 1.0) / (2 if observation.joint else 1)
        refuted = [pair for pair in self.unconfirmed if pair[0].id == id]
        return dc.replace(
            self,
            estimate=estimate.updated(observation, weight).with_rules(),
            unconfirmed=tuple(pair for pair in self.unconfirmed if pair[0].id != id),
            counts=self.counts | {id: self.counts.get(id, 0) + 1},
            times=self.times | {id: observation.time},
        )._refusing(*refuted)

    def _restarted(
        self, estimate: GateFilter, unconfirmed: tuple, agreed: Iterable[Observation]
    ) -> "GateTrack":
        """Returns the track of the gate where observations in agreement put it.

        Args:
            estimate: the fit to them.
            unconfirmed: they and the others, which may fit now.
            agreed: the observations.
        """
        track = dc.replace(
            self,
            estimate=estimate,
            unconfirmed=(),
            counts=dict(Counter(self.counts) + Counter(o.id for o in agreed)),
            times={o.id: o.time for o in agreed},
            was_certain=self.was_certain or self._is_certain(),
        )
        for observation, reason in unconfirmed:
            if any(observation is o for o in agreed):
                continue
            rest = (*track.unconfirmed, (observation, reason))
            track = track._accepting(observation) or dc.replace(track, unconfirmed=rest)
        return track


def _is_behind(estimate: GateFilter, observation: Observation) -> bool:
    """Whether the camera was behind the face of the board that it seems to have seen."""
    return estimate.heading_variance < _HEADING_SIGMA**2 and gate_filter.is_behind(
        estimate.state, observation, _REACH
    )


class RobustEstimator:
    """Estimates whole gates from observations weighted by their covariance.

    An observation of one board says something about all four.

    The variance of a MarkerEstimate is that of its error, and an outlier is
    any observation that is refused here.
    """

    def __init__(self, *, min_observations: int):
        """Args: min_observations: of both pylons before a gate is in the map."""
        self._min_observations = min_observations

    def updated(self, tracks: dict, observation: Observation) -> dict:
        """Returns gate number to GateTrack after one more observation."""
        number = observation.id // 4
        return tracks | {number: tracks.get(number, GateTrack()).updated(observation)}

    def make_map(self, tracks: dict, **counters: Any) -> GateMap:
        """Returns the map; counters: the attributes of GateMap that count."""
        refused = Counter(counters.pop("refused", {}))
        markers, gates = (), ()
        for number, track in sorted(tracks.items()):
            of_gate = _map_of_gate(number, track, self._min_observations)
            markers, gates = markers + of_gate.markers, gates + of_gate.gates
            refused.update(of_gate.refused)
        return GateMap(
            markers=markers, gates=gates, refused=dict(sorted(refused.items())), **counters
        )


@functools.lru_cache(maxsize=256)  # an image changes the tracks of a gate or two
def _map_of_gate(number: int, track: GateTrack, min_observations: int) -> GateMap:
    """Returns the map of one gate, without counters.

    Boards of a known gate are in it even if they were never seen.
    """
    refused, outliers = Counter(), Counter()
    for (id, reason), count in track.all_refused().items():
        refused[reason] += count
        outliers[id] += count
    estimate, is_known = track.estimate, track.is_known(min_observations)
    if estimate is None:
        return GateMap(refused=refused)
    boards = read_only(gate_filter.boards(estimate.state, estimate.covariance))
    gate = GateEstimate(
        number=number,
        p_WG=read_only(gate_filter.as_gate(estimate.state).p_WG),
        heading=wrap_angle(estimate.heading),
        spacing=estimate.spacing,
    )
    return GateMap(
        markers=tuple(
            MarkerEstimate(id, track.counts.get(id, 0), outliers[id], *board)
            for id, board in enumerate(boards, 4 * number)
            if is_known or id in track.counts
        ),
        gates=(gate,) if is_known else (),
        refused=refused,
    )
