"""The map for explorer and planner, from what the filter believes."""

import numpy as np

from airrace.common.immutable import read_only
from airrace.common.jit import compiled
from airrace.math.angles import wrap_angle
from airrace.systems.estimation.kalman_update import Belief, relative_covariance
from airrace.systems.estimation.slam_state import SlamState
from airrace.systems.mapping import gate_filter
from airrace.systems.perception.detection_checks import FOREIGN_ID
from airrace.track.gate_map import GateEstimate, GateMap, MarkerEstimate


def map_of(state: SlamState) -> GateMap:
    """Returns the map that follows from what the filter knows.

    Its variances are those of the position relative to the drone and its heading: what counts
    when the drone has to pass a pylon. Where both are in the world matters to nobody in flight.
    """
    belief = state.belief
    states, headings = (
        read_only(belief.gates),
        wrap_angle(belief.gates[:, gate_filter.AT_GATE.heading]).tolist(),
    )
    boards = read_only(_boards(belief))
    markers, gates = [], []
    for index, landmark in sorted(enumerate(state.landmarks), key=lambda each: each[1].number):
        number, counts, outliers = landmark.number, landmark.counts, landmark.outliers
        markers += [
            MarkerEstimate(id, counts.get(id, 0), outliers.get(id, 0), *board)
            for id, board in enumerate(boards[index], 4 * number)
            if landmark.is_known or id in counts
        ]
        if landmark.is_known:
            p_WG, _, spacing = gate_filter.as_gate(states[index])
            gates.append(GateEstimate(number, p_WG, headings[index], float(spacing)))
    return GateMap(
        time=state.image_time,
        markers=tuple(markers),
        gates=tuple(gates),
        detections=state.detections,
        out_of_range=state.refused.get(FOREIGN_ID, 0),
        refused=dict(sorted(state.refused.items())),
    )


@compiled
def _boards(belief: Belief) -> np.ndarray:
    """Returns gate_filter.boards() of each gate, (n, 4, 3, 3)."""
    result = np.empty((len(belief.gates), 4, 3, 3))
    for n in range(len(result)):
        result[n] = gate_filter.boards(belief.gates[n], relative_covariance(belief, n))
    return result
