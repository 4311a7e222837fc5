"""The map of the track: what the autonomy knows of its markers and gates."""

import dataclasses as dc

import numpy as np

from airrace.common.immutable import Immutable


@dc.dataclass(frozen=True, eq=False)
class MarkerEstimate(Immutable):
    """What is known of one marker.

    Attributes:
        id: the ArUco ID.
        count: number of observations that count; 0 of a board that only the
            others of its gate tell of.
        outliers: number of observations that were rejected.
        p_WM: position of the board's centre, (3,).
        variance: of each coordinate (m^2), (3,); what it is of, the
            estimator says.
        normal: unit vector out of the board's face, (3,).
    """

    id: int
    count: int
    outliers: int
    p_WM: np.ndarray
    variance: np.ndarray
    normal: np.ndarray


@dc.dataclass(frozen=True, eq=False)
class GateEstimate(Immutable):
    """What is known of one gate.

    Attributes:
        number: of the gate, n = 0, 1, ... as in the marker IDs.
        p_WG: midpoint between the pylon axes at the boards' height, (3,).
        heading: direction of flight through it (rad).
        spacing: between the two pylon axes (m).
    """

    number: int
    p_WG: np.ndarray
    heading: float
    spacing: float

    @property
    def forward(self) -> np.ndarray:
        """Unit vector of flight, shape (3,)."""
        return np.array([np.cos(self.heading), np.sin(self.heading), 0.0])

    @property
    def pylons(self) -> np.ndarray:
        """Axes of the left and the right pylon, [x, y], (2, 2)."""
        half = self.spacing / 2 * np.array([np.sin(self.heading), -np.cos(self.heading)])
        return np.array([self.p_WG[:2] - half, self.p_WG[:2] + half])


@dc.dataclass(frozen=True, eq=False)
class GateMap(Immutable):
    """The map of the track.

    Attributes:
        time: of the newest image in it (s).
        markers: tuple of MarkerEstimate, by ID.
        gates: tuple of GateEstimate of the gates whose two pylons are known,
            by number.
        detections: number of markers detected so far.
        out_of_range: how many of them had an impossible ID.
        refused: dict of why a marker, or what looked like one, did not enter
            the map, to how many times.
    """

    time: float = -1.0
    markers: tuple = ()
    gates: tuple = ()
    detections: int = 0
    out_of_range: int = 0
    refused: dict = dc.field(default_factory=dict)

    @property
    def error_rate(self) -> float:
        """Share of the detections with an impossible ID."""
        return self.out_of_range / max(self.detections, 1)
