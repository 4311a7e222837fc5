"""The map for explorer and planner, from what the filter believes."""

from airrace.common.immutable import read_only
from airrace.math.angles import wrap_angle
from airrace.systems.estimation.kalman_update import relative_covariance
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
