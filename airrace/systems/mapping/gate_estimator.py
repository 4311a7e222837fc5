"""The robust estimator: gates are rigid, observations differ in worth, and some are wrong."""

import dataclasses as dc
import functools
from collections import Counter

import numpy as np

from airrace.common.immutable import Immutable, read_only
from airrace.systems.mapping import gate_belief as gb
from airrace.systems.mapping import gate_filter as gf
from airrace.systems.mapping.observation import OFF_MAP, UNCONFIRMED, Observation
from airrace.systems.perception.detection_checks import FROM_BEHIND, JUMP
from airrace.track import PYLON_BASE_RADIUS
from airrace.track.gate_map import GateEstimate, GateMap, MarkerEstimate

_DOUBTED = 8  # observations of a gate that may wait for another in agreement
_ERROR_TIME = 0.15  # s, for which the errors of one marker's observations stay the same
_JUMP_TIME = 0.5  # s: what was where it should be so shortly ago has jumped since
_NEAR = 3.0  # m, from a board to the other face of its pylon and a little more
_GATE_SIGMA = 0.3  # m, of a gate's midpoint, before it is in the map
_HEADING_SIGMA = 0.2  # rad, of a heading that tells front from back


@dc.dataclass(frozen=True, eq=False)
class GateRecord(Immutable):
    """What is remembered of one gate; a new one for every observation.

    Attributes:
        belief: where it stands, None before two observations agreed.
        doubted: pairs of an observation that does not fit and the reason to
            refuse it, oldest first.
        counts: marker ID to how many observations count.
        times: marker ID to the time of the newest that counts (s).
        refused: (marker ID, reason) to how many are refused for good.
        certain_once: whether it was known well where it stood before it moved.
    """

    belief: gb.GateBelief | None = None
    doubted: tuple = ()
    counts: dict = dc.field(default_factory=dict)
    times: dict = dc.field(default_factory=dict)
    refused: dict = dc.field(default_factory=dict)
    certain_once: bool = False

    def seen(self, observation: Observation) -> "GateRecord":
        """Returns the record after one more observation of one of the gate's boards."""
        reason = UNCONFIRMED
        if self.belief is not None:
            if self._is_behind(observation):
                return self._refusing((observation, FROM_BEHIND))
            if self.belief.distance(observation) <= gb.CHI_SQUARE_3:
                return self._counting(observation)
            ago = observation.time - self.times.get(observation.id, -np.inf)
            reason = JUMP if ago <= _JUMP_TIME else OFF_MAP
        doubted = (*self.doubted, (observation, reason))
        for other, _ in doubted[-2::-1]:
            belief = gb.agreement(other, observation, self.belief)
            if belief is not None:
                return self._restarted(belief, doubted, (other, observation))
        forgotten, kept = doubted[:-_DOUBTED], doubted[-_DOUBTED:]
        return dc.replace(self, doubted=kept)._refusing(*forgotten)

    def all_refused(self) -> Counter:
        """Returns how many observations, by marker ID and reason, do not count today."""
        return Counter(self.refused) + Counter((s.id, reason) for s, reason in self.doubted)

    def _is_behind(self, observation) -> bool:
        """Whether the camera is on the wrong side of the face that it claims to have seen."""
        belief = self.belief
        return belief.covariance[gf.HEADING, gf.HEADING] < _HEADING_SIGMA**2 and gf.is_behind(
            belief.pose, observation.id, observation.p_WM, observation.p_WC, _NEAR
        )

    def _refusing(self, *doubted) -> "GateRecord":
        if not doubted:
            return self
        refused = Counter(self.refused) + Counter((s.id, reason) for s, reason in doubted)
        return dc.replace(self, refused=dict(refused))

    def _counting(self, observation) -> "GateRecord":
        """Returns the record with an observation that fits.

        Those of its marker that did not are on their own now. A pair of
        observations that was solved as one rigid body counts as one.
        """
        ago = observation.time - self.times.get(observation.id, -np.inf)
        weight = min(max(ago, 0.0) / _ERROR_TIME, 1.0) / (2 if observation.joint else 1)
        refuted = [pair for pair in self.doubted if pair[0].id == observation.id]
        return GateRecord(
            self.belief.updated(observation, weight).knowing_the_rules(),
            tuple(pair for pair in self.doubted if pair[0].id != observation.id),
            self.counts | {observation.id: self.counts.get(observation.id, 0) + 1},
            self.times | {observation.id: observation.time},
            self.refused,
            self.certain_once,
        )._refusing(*refuted)

    def _restarted(self, belief, doubted, agreed) -> "GateRecord":
        """Returns the record of the gate where observations in agreement put it.

        Args:
            belief: the fit to them.
            doubted: with them and the others.
            agreed: the observations.
        """
        record = dc.replace(
            self,
            belief=belief,
            doubted=(),
            counts=dict(Counter(self.counts) + Counter(s.id for s in agreed)),
            times={s.id: s.time for s in agreed},
            certain_once=self.certain_once or _is_certain(self.belief),
        )
        for observation, reason in doubted:
            if any(observation is s for s in agreed):
                continue
            if record.belief.distance(observation) <= gb.CHI_SQUARE_3:
                record = record._counting(observation)
            else:
                record = dc.replace(record, doubted=(*record.doubted, (observation, reason)))
        return record


class RobustEstimator:
    """Finds whole gates from observations weighted by their covariance.

    An observation of one board says something of all four. It counts if it fits
    where the gate is believed to stand; if it does not, it waits. Two of
    different images that agree with each other beat the belief: a first
    observation that is wrong, or a gate that has moved, does no lasting harm.

    The variance of a MarkerEstimate is that of its error, and an outlier is
    any observation that is refused here.
    """

    def __init__(self, *, min_observations):
        """Args: min_observations: of both pylons before a gate is in the map."""
        self._min_observations = min_observations

    def updated(self, records: dict, observation: Observation) -> dict:
        """Returns gate number to GateRecord after one more observation."""
        number = observation.id // 4
        return records | {number: records.get(number, GateRecord()).seen(observation)}

    def make_map(self, records: dict, **counters) -> GateMap:
        """Returns the map; counters: the attributes of GateMap that count."""
        refused = Counter(counters.pop("refused", {}))
        markers, gates = (), ()
        for number, record in sorted(records.items()):
            of_gate = _described(number, record, self._min_observations)
            markers, gates = markers + of_gate.markers, gates + of_gate.gates
            if of_gate.refused:
                refused.update(of_gate.refused)
        return GateMap(
            markers=markers, gates=gates, refused=dict(sorted(refused.items())), **counters
        )


@functools.lru_cache(maxsize=256)  # an image changes the records of a gate or two
def _described(number, record: GateRecord, min_observations) -> GateMap:
    """Returns the map of one gate, without counters.

    Boards of a known gate are in it even if nobody has seen them.
    """
    refused, outliers = Counter(), Counter()
    for (id, reason), count in record.all_refused().items():
        refused[reason] += count
        outliers[id] += count
    if record.belief is None:
        return GateMap(refused=refused)
    known = _is_known(number, record, min_observations)
    boards = read_only(gf.boards(record.belief.pose, record.belief.covariance, 4 * number))
    return GateMap(
        markers=tuple(
            MarkerEstimate(id, record.counts.get(id, 0), outliers[id], *boards[:, id % 4])
            for id in range(4 * number, 4 * number + 4)
            if known or id in record.counts
        ),
        gates=(_gate_estimate(number, record.belief),) if known else (),
        refused=refused,
    )


def _is_known(number, record: GateRecord, min_observations) -> bool:
    counts = [record.counts.get(4 * number + i, 0) for i in range(4)]
    return bool(
        min(counts[0] + counts[1], counts[2] + counts[3]) >= min_observations
        and record.belief.pose[gf.SPACING] > 2 * PYLON_BASE_RADIUS
        # A gate that moved stays in the map, even if it was hardly seen since.
        and (record.certain_once or _is_certain(record.belief))
    )


def _is_certain(belief: gb.GateBelief | None) -> bool:
    """Whether it is known well where a gate stands."""
    return belief is not None and gf.is_below(belief.covariance, _GATE_SIGMA**2)


def _gate_estimate(number, belief) -> GateEstimate:
    return GateEstimate(
        number=number,
        p_WG=read_only(belief.pose[:3]),
        heading=gf.turn_between(belief.pose[gf.HEADING], 0.0),
        spacing=float(belief.pose[gf.SPACING]),
    )
