"""The map for explorer and planner, from what the filter believes."""

from airrace.common.immutable import read_only
from airrace.math.angles import wrap_angle
from airrace.systems.estimation.kalman_update import Belief, relative_covariance
from airrace.systems.estimation.landmarks import Landmark
from airrace.systems.mapping import gate_filter
from airrace.track.gate_map import GateEstimate, MarkerEstimate


def map_of_gate(belief: Belief, index: int, landmark: Landmark) -> tuple[tuple, tuple]:
    """Returns MarkerEstimates and GateEstimates of one gate.

    Their variances are those of the position relative to the drone and its heading: what counts
    when the drone has to pass a pylon. Where both are in the world matters to nobody in flight.

    Args:
        belief: of the filter.
        index: of the gate in it.
        landmark: what else is known of the gate.
    """
    state, number = belief.gates[index], landmark.number
    boards = read_only(gate_filter.boards(state, relative_covariance(belief, index)))
    markers = tuple(
        MarkerEstimate(id, landmark.counts.get(id, 0), landmark.outliers.get(id, 0), *board)
        for id, board in enumerate(boards, 4 * number)
        if landmark.is_known or id in landmark.counts
    )
    if not landmark.is_known:
        return markers, ()
    gate = GateEstimate(
        number=number,
        p_WG=read_only(state[:3]),
        heading=float(wrap_angle(state[3])),
        spacing=float(state[4]),
    )
    return markers, (gate,)
