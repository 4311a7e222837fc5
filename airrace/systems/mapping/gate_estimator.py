"""The robust estimator: gates are rigid, sightings differ in worth, and some are wrong."""

import dataclasses as dc
import functools
from collections import Counter

import numpy as np

from airrace.common.immutable import Immutable, read_only
from airrace.systems.mapping import gate_belief as gb
from airrace.systems.mapping import gate_filter as gf
from airrace.systems.mapping.observation import OFF_MAP, UNCONFIRMED, Sighting
from airrace.systems.perception.detection_checks import FROM_BEHIND, JUMP
from airrace.systems.types import GateEstimate, GateMap, MarkerEstimate
from airrace.track import PYLON_BASE_RADIUS

_DOUBTED = 8  # sightings of a gate that may wait for another in agreement
_ERROR_TIME = 0.15  # s, for which the errors of one marker's sightings stay the same
_JUMP_TIME = 0.5  # s: what was where it should be so shortly ago has jumped since
_NEAR = 3.0  # m, from a board to the other face of its pylon and a little more
_GATE_SIGMA = 0.3  # m, of a gate's midpoint, before it is in the map
_HEADING_SIGMA = 0.2  # rad, of a heading that tells front from back


@dc.dataclass(frozen=True, eq=False)
class GateRecord(Immutable):
    """What is remembered of one gate; a new one for every sighting.

    Attributes:
        belief: where it stands, None before two sightings agreed.
        doubted: pairs of a sighting that does not fit and the reason to
            refuse it, oldest first.
        counts: marker ID to how many sightings count.
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

    def seen(self, sighting: Sighting) -> "GateRecord":
        """Returns the record after one more sighting of one of the gate's boards."""
        reason = UNCONFIRMED
        if self.belief is not None:
            if self._is_behind(sighting):
                return self._refusing((sighting, FROM_BEHIND))
            if self.belief.distance(sighting) <= gb.CHI_SQUARE_3:
                return self._counting(sighting)
            ago = sighting.time - self.times.get(sighting.id, -np.inf)
            reason = JUMP if ago <= _JUMP_TIME else OFF_MAP
        doubted = (*self.doubted, (sighting, reason))
        for other, _ in doubted[-2::-1]:
            belief = gb.agreement(other, sighting, self.belief)
            if belief is not None:
                return self._restarted(belief, doubted, (other, sighting))
        forgotten, kept = doubted[:-_DOUBTED], doubted[-_DOUBTED:]
        return dc.replace(self, doubted=kept)._refusing(*forgotten)

    def all_refused(self) -> Counter:
        """Returns how many sightings, by marker ID and reason, do not count today."""
        return Counter(self.refused) + Counter((s.id, reason) for s, reason in self.doubted)

    def _is_behind(self, sighting) -> bool:
        """Whether the camera is on the wrong side of the face that it claims to have seen."""
        belief = self.belief
        return belief.covariance[gf.HEADING, gf.HEADING] < _HEADING_SIGMA**2 and gf.is_behind(
            belief.pose, sighting.id, sighting.p_WM, sighting.p_WC, _NEAR
        )

    def _refusing(self, *doubted) -> "GateRecord":
        if not doubted:
            return self
        refused = Counter(self.refused) + Counter((s.id, reason) for s, reason in doubted)
        return dc.replace(self, refused=dict(refused))

    def _counting(self, sighting) -> "GateRecord":
        """Returns the record with a sighting that fits.

        Those of its marker that did not are on their own now. A pair of
        sightings that was solved as one rigid body counts as one.
        """
        ago = sighting.time - self.times.get(sighting.id, -np.inf)
        weight = min(max(ago, 0.0) / _ERROR_TIME, 1.0) / (2 if sighting.joint else 1)
        refuted = [pair for pair in self.doubted if pair[0].id == sighting.id]
        return GateRecord(
            self.belief.updated(sighting, weight).knowing_the_rules(),
            tuple(pair for pair in self.doubted if pair[0].id != sighting.id),
            self.counts | {sighting.id: self.counts.get(sighting.id, 0) + 1},
            self.times | {sighting.id: sighting.time},
            self.refused,
            self.certain_once,
        )._refusing(*refuted)

    def _restarted(self, belief, doubted, agreed) -> "GateRecord":
        """Returns the record of the gate where sightings in agreement put it.

        Args:
            belief: the fit to them.
            doubted: with them and the others.
            agreed: the sightings.
        """
        record = dc.replace(
            self,
            belief=belief,
            doubted=(),
            counts=dict(Counter(self.counts) + Counter(s.id for s in agreed)),
            times={s.id: s.time for s in agreed},
            certain_once=self.certain_once or _is_certain(self.belief),
        )
        for sighting, reason in doubted:
            if any(sighting is s for s in agreed):
                continue
            if record.belief.distance(sighting) <= gb.CHI_SQUARE_3:
                record = record._counting(sighting)
            else:
                record = dc.replace(record, doubted=(*record.doubted, (sighting, reason)))
        return record


class RobustEstimator:
    """Finds whole gates from sightings weighted by their covariance.

    A sighting of one board says something of all four. It counts if it fits
    where the gate is believed to stand; if it does not, it waits. Two of
    different images that agree with each other beat the belief: a first
    sighting that is wrong, or a gate that has moved, does no lasting harm.

    The variance of a MarkerEstimate is that of its error, and an outlier is
    any sighting that is refused here.
    """

    def __init__(self, *, min_sightings):
        """Args: min_sightings: of both pylons before a gate is in the map."""
        self._min_sightings = min_sightings

    def updated(self, records: dict, sighting: Sighting) -> dict:
        """Returns gate number to GateRecord after one more sighting."""
        number = sighting.id // 4
        return records | {number: records.get(number, GateRecord()).seen(sighting)}

    def make_map(self, records: dict, **counters) -> GateMap:
        """Returns the map; counters: the attributes of GateMap that count."""
        refused = Counter(counters.pop("refused", {}))
        markers, gates = (), ()
        for number, record in sorted(records.items()):
            of_gate = _described(number, record, self._min_sightings)
            markers, gates = markers + of_gate.markers, gates + of_gate.gates
            if of_gate.refused:
                refused.update(of_gate.refused)
        return GateMap(
            markers=markers, gates=gates, refused=dict(sorted(refused.items())), **counters
        )


@functools.lru_cache(maxsize=256)  # an image changes the records of a gate or two
def _described(number, record: GateRecord, min_sightings) -> GateMap:
    """Returns the map of one gate, without counters.

    Boards of a known gate are in it even if nobody has seen them.
    """
    refused, outliers = Counter(), Counter()
    for (id, reason), count in record.all_refused().items():
        refused[reason] += count
        outliers[id] += count
    if record.belief is None:
        return GateMap(refused=refused)
    known = _is_known(number, record, min_sightings)
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


def _is_known(number, record: GateRecord, min_sightings) -> bool:
    counts = [record.counts.get(4 * number + i, 0) for i in range(4)]
    return bool(
        min(counts[0] + counts[1], counts[2] + counts[3]) >= min_sightings
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
