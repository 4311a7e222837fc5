"""A course of square gates: from a pad through gate after gate to the last one."""

import dataclasses as dc
import itertools

import numpy as np

from airrace.track.course import Course
from airrace.track.hall import Hall, hall_around
from airrace.track.square_gate import OUTER, SquareGate
from airrace.track.start import Start, require

SQUARE = "square"
LAWN, HALL = "lawn", "hall"


@dc.dataclass
class GateKind:
    """What kind of gates a track has; tracks of pylons do not say it."""

    kind: str = SQUARE


@dc.dataclass
class SquareTrack(Course):
    """A course through two or more square gates, flown once from the pad; see Course."""

    name: str = ""
    gate: GateKind = dc.field(default_factory=GateKind)  #: the kind of its gates, square
    #: "hall", dark and with lights below its ceiling, or "lawn", under the sky.
    surroundings: str = HALL
    start: Start = dc.field(default_factory=Start)
    gates: list[SquareGate] = dc.field(default_factory=list)

    closed = has_markers = False
    notes = """\
# World frame: x forward, y left, z up; metres and degrees. A gate's position is the
# middle of its opening, its yaw the direction of flight through it, and its pitch how
# much that points down. The pad descends by pad_tilt_deg in pad_tilt_direction_deg.
# surroundings: hall (dark), or lawn.
"""
    _fewest_gates, _steepest_pad_deg = 2, 25.0

    @property
    def hover_height(self) -> float:
        return self.gates[0].position[2] - self.start.position[2]

    def outline(self) -> np.ndarray:
        return np.vstack([*(gate.corners() for gate in self.gates), [self.start.position]])

    def frames(self) -> list[SquareGate]:
        return self.gates

    def hall(self) -> Hall | None:
        return hall_around(self.outline(), self.way()) if self.surroundings == HALL else None

    def _check_layout(self) -> None:
        require(self.gate.kind == SQUARE, f"gate.kind must be {SQUARE}, not '{self.gate.kind}'")
        require(
            self.surroundings in (HALL, LAWN),
            f"surroundings must be {HALL} or {LAWN}, not '{self.surroundings}'",
        )
        for (i, one), (j, other) in itertools.combinations(enumerate(self.gates, 1), 2):
            apart = np.linalg.norm(one.p_WG - other.p_WG)
            require(apart > 1.5 * OUTER, f"gates {i} and {j} overlap")
        near = np.linalg.norm([gate.p_WG - self.start.position for gate in self.gates], axis=1)
        require(near.min() > OUTER, f"the start is too close to gate {near.argmin() + 1}")
