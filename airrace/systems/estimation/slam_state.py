"""What the filter of drone and gates knows."""

import dataclasses as dc

import numpy as np

from airrace.common.immutable import Immutable, read_only
from airrace.math.angles import wrap_angle
from airrace.systems.estimation.alignment import NO_REST, Rest
from airrace.systems.estimation.error_state import DRONE
from airrace.systems.estimation.gate_projection import GATE
from airrace.systems.estimation.kalman_update import Belief, relative_covariance
from airrace.systems.estimation.navigation import NAVIGATION_SIZE
from airrace.systems.mapping import gate_filter
from airrace.systems.perception.detection_checks import FOREIGN_ID
from airrace.track.gate_map import GateEstimate, GateMap, MarkerEstimate


@dc.dataclass(frozen=True, eq=False)
class SlamState(Immutable):
    """What the filter knows; a new one for every picture. Its arrays are never written to.

    Attributes:
        belief: see Belief; its time is that of the newest picture's exposure.
        landmarks: tuple of Landmark, in the order of the belief's gates.
        candidates: number of a gate to its Candidate, of all that were seen before they entered.
        rest: means of the samples at rest.
        still: marker ID to the Still of its corners, of the markers that were seen at rest.
        at_rest: whether the rotors have not turned yet.
        image_time: of the newest picture (s).
        refused: reason to how many detections did not enter the map.
        detections: how many markers have been detected, foreign ones among them.
        innovations: tuple of (marker ID, normalised innovation squared) of the newest picture.
        refused_in_a_row: pictures up to now in which known markers were seen, and all refused.
        fault: why the drone cannot go by this any more, see why_lost(); empty if it can.
    """

    belief: Belief = Belief(
        np.array([-1.0, 1.0, *[0.0] * (NAVIGATION_SIZE - 2)]), np.zeros((0, GATE)), np.eye(DRONE)
    )
    landmarks: tuple = ()
    candidates: dict = dc.field(default_factory=dict)
    rest: Rest = NO_REST
    still: dict = dc.field(default_factory=dict)
    at_rest: bool = True
    image_time: float = -1.0
    refused: dict = dc.field(default_factory=dict)
    detections: int = 0
    innovations: tuple = ()
    refused_in_a_row: int = 0
    fault: str = ""

    @property
    def time(self) -> float:
        """That the belief is of (s), negative before there is one."""
        return float(self.belief.navigation[0])

    def index_of(self, number: int) -> int | None:
        """Returns where a gate is in the belief, None if it is not."""
        for index, landmark in enumerate(self.landmarks):
            if landmark.number == number:
                return index
        return None


def map_of(state: SlamState) -> GateMap:
    """Returns the map that follows from what the filter knows.

    Its variances are those of the position relative to the drone and its heading: what counts
    when the drone has to pass a pylon. Where both are in the world matters to nobody in flight.
    """
    belief = state.belief
    states, markers, gates = read_only(belief.gates), [], []
    for index, landmark in sorted(enumerate(state.landmarks), key=lambda each: each[1].number):
        number, counts, outliers = landmark.number, landmark.counts, landmark.outliers
        boards = read_only(
            gate_filter.boards(belief.gates[index], relative_covariance(belief, index))
        )
        markers += [
            MarkerEstimate(id, counts.get(id, 0), outliers.get(id, 0), *board)
            for id, board in enumerate(boards, 4 * number)
            if landmark.is_known or id in counts
        ]
        if landmark.is_known:
            p_WG, heading, spacing = gate_filter.as_gate(states[index])
            gates.append(GateEstimate(number, p_WG, float(wrap_angle(heading)), float(spacing)))
    return GateMap(
        time=state.image_time,
        markers=tuple(markers),
        gates=tuple(gates),
        detections=state.detections,
        out_of_range=state.refused.get(FOREIGN_ID, 0),
        refused=dict(sorted(state.refused.items())),
    )
