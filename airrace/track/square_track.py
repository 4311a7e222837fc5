"""A course of square gates: from a pad through gate after gate to the last one."""

import dataclasses as dc
import itertools
from pathlib import Path

import numpy as np

from airrace.common.errors import UserError
from airrace.common.resources import find_yaml, load_yaml
from airrace.track.hall import Hall, hall_around
from airrace.track.square_gate import MAX_PITCH_DEG, OUTER, SquareGate
from airrace.track.start import Start
from airrace.track.track import MAX_GATES, SQUARE, Board, Track, is_square, load_track

LAWN, HALL = "lawn", "hall"
MAX_PAD_TILT_DEG = 25.0  # of the start; a drone slips off a steeper one
_ABOVE_GROUND = OUTER / 2  # m, of a gate's middle, so that its frame does not stick in the ground


@dc.dataclass
class GateKind:
    """What kind of gates a track has; tracks of pylons do not say it."""

    kind: str = SQUARE


@dc.dataclass
class SquareTrack:
    """A course through square gates; the gates are listed in racing order.

    It is flown once, from the pad through the last gate, and has no laps.

    Attributes:
        name: what results are filed under.
        gate: the kind of its gates, square.
        surroundings: "hall", dark and with lights below its ceiling, or "lawn", under the sky.
        start: the pad.
        gates: at least two.
    """

    name: str = ""
    gate: GateKind = dc.field(default_factory=GateKind)
    surroundings: str = HALL
    start: Start = dc.field(default_factory=Start)
    gates: list[SquareGate] = dc.field(default_factory=list)

    @property
    def closed(self) -> bool:
        """Whether the track leads back to its first gate."""
        return False

    def outline(self) -> np.ndarray:
        """Returns points that the course lies between: corners of all frames, the pad, (n, 3) m."""
        return np.vstack([*(gate.corners() for gate in self.gates), [self.start.position]])

    def boards(self) -> list[Board]:
        """Returns no boards: square gates have no markers."""
        return []

    def pylons(self) -> np.ndarray:
        """Returns no pylons, (0, 3)."""
        return np.empty((0, 3))

    def hall(self) -> Hall | None:
        """Returns the hall around the course; None on the lawn."""
        if self.surroundings != HALL:
            return None
        gates = np.array([gate.p_WG for gate in self.gates])
        return hall_around(self.outline(), np.vstack([[self.start.position], gates]))

    def check(self) -> None:
        """Raises ValueError with one clause that says what is wrong."""
        _require(self.name, "it has no name")
        _require(self.gate.kind == SQUARE, f"gate.kind must be {SQUARE}, not '{self.gate.kind}'")
        _require(
            self.surroundings in (HALL, LAWN),
            f"surroundings must be {HALL} or {LAWN}, not '{self.surroundings}'",
        )
        start = self.start
        numbers = [*start.position, start.heading_deg, start.pad_tilt_direction_deg]
        _require(
            len(start.position) == 3 and np.all(np.isfinite(numbers)),
            "start.position needs three numbers, and start.heading_deg one, all finite",
        )
        _require(start.position[2] >= 0.0, "the start lies below the ground")
        _require(
            0.0 <= start.pad_tilt_deg <= MAX_PAD_TILT_DEG,
            f"start.pad_tilt_deg must lie between 0 and {MAX_PAD_TILT_DEG:.0f}",
        )
        _require(
            2 <= len(self.gates) <= MAX_GATES,
            f"a course needs at least 2 gates and at most {MAX_GATES}, not {len(self.gates)}",
        )
        for i, gate in enumerate(self.gates, 1):
            _check_gate(i, gate)
        for (i, one), (j, other) in itertools.combinations(enumerate(self.gates, 1), 2):
            apart = np.linalg.norm(one.p_WG - other.p_WG)
            _require(apart > 1.5 * OUTER, f"gates {i} and {j} overlap")
        near = np.linalg.norm([gate.p_WG - start.position for gate in self.gates], axis=1)
        _require(near.min() > OUTER, f"the start is too close to gate {near.argmin() + 1}")


AnyTrack = Track | SquareTrack


def load_course(name_or_file: str) -> AnyTrack:
    """Loads and checks a track, whatever its gates are.

    Args:
        name_or_file: the name of a shipped track or the path of a YAML file.

    Raises:
        UserError: if it is missing, malformed or impossible to fly.
    """
    path = find_yaml("tracks", name_or_file)
    return load_square_track(path) if is_square(path) else load_track(name_or_file)


def load_square_track(path: Path) -> SquareTrack:
    """Loads and checks the file of a course of square gates.

    Raises:
        UserError: if it is malformed or impossible to fly.
    """
    track = load_yaml(SquareTrack, filename=path)
    try:
        track.check()
    except ValueError as e:
        raise UserError(f"The track {path} cannot be raced: {e}.") from None
    return track


def _check_gate(i: int, gate: SquareGate) -> None:
    _require(len(gate.position) == 3, f"position of gate {i} needs three numbers")
    _require(
        np.all(np.isfinite([*gate.position, gate.yaw_deg, gate.pitch_deg])),
        f"a number of gate {i} is missing or not finite",
    )
    _require(
        abs(gate.pitch_deg) <= MAX_PITCH_DEG,
        f"pitch_deg of gate {i} must lie between -{MAX_PITCH_DEG:.0f} and {MAX_PITCH_DEG:.0f}",
    )
    _require(gate.p_WG[2] >= _ABOVE_GROUND, f"the frame of gate {i} sticks in the ground")


def _require(condition, message):
    if not condition:
        raise ValueError(message)
