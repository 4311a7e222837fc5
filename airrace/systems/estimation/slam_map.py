"""The map for explorer and planner, from what the filter believes."""

import numpy as np

from airrace.common.immutable import read_only
from airrace.common.jit import compiled
from airrace.math.angles import wrap_angle
from airrace.systems.estimation.kalman_update import Belief, relative_covariances
from airrace.systems.estimation.landmarks import Landmark
from airrace.systems.mapping import gate_filter
from airrace.track.gate_map import GateEstimate, MarkerEstimate


def estimates_of(belief: Belief, landmarks: tuple[Landmark, ...]) -> tuple[tuple, tuple]:
    """Returns MarkerEstimates and GateEstimates, by the numbers of the gates.

    Their variances are those of the position relative to the drone and its heading: what counts
    when the drone has to pass a pylon. Where both are in the world matters to nobody in flight.

    Args:
        belief: of the filter.
        landmarks: what else is known of its gates.
    """
    states, headings = read_only(belief.gates), wrap_angle(belief.gates[:, 3]).tolist()
    boards = read_only(_boards(belief.gates, relative_covariances(belief)))
    markers, gates = [], []
    for index, landmark in sorted(enumerate(landmarks), key=lambda each: each[1].number):
        number, counts, outliers = landmark.number, landmark.counts, landmark.outliers
        markers += [
            MarkerEstimate(id, counts.get(id, 0), outliers.get(id, 0), *board)
            for id, board in enumerate(boards[index], 4 * number)
            if landmark.is_known or id in counts
        ]
        if landmark.is_known:
            state = states[index]
            gates.append(GateEstimate(number, state[:3], headings[index], float(state[4])))
    return tuple(markers), tuple(gates)


@compiled
def _boards(gates, covariances):
    """Returns gate_filter.boards() of each gate, (n, 4, 3, 3); (n, 5) and (n, 5, 5)."""
    result = np.empty((len(gates), 4, 3, 3))
    for n in range(len(gates)):
        result[n] = gate_filter.boards(gates[n], covariances[n])
    return result
