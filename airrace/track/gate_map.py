"""The map of the track: what the autonomy knows of its markers and gates."""

import dataclasses as dc

import numpy as np

from airrace.common.immutable import Immutable


@dc.dataclass(frozen=True, eq=False)
class MarkerEstimate(Immutable):
    """What is known of one marker."""

    id: int  #: the ArUco ID
    count: int  #: of observations that count; 0 of a board that only the others of its gate tell of
    outliers: int  #: how many observations were rejected
    p_WM: np.ndarray  #: position of the board's centre (m), (3,)
    variance: np.ndarray  #: of each coordinate (m^2), (3,); what it is of, the estimator says
    normal: np.ndarray  #: unit vector out of the board's face, (3,)


@dc.dataclass(frozen=True, eq=False)
class GateEstimate(Immutable):
    """What is known of one gate."""

    number: int  #: of the gate, n = 0, 1, ... as in the marker IDs.
    p_WG: np.ndarray  #: midpoint between the pylon axes at the boards' height, (3,)
    heading: float  #: direction of flight through it (rad)
    spacing: float  #: between the two pylon axes (m)

    @property
    def forward(self) -> np.ndarray:
        """Unit vector of flight, (3,)."""
        return np.array([np.cos(self.heading), np.sin(self.heading), 0.0])

    @property
    def pylons(self) -> np.ndarray:
        """Axes of the left and the right pylon, [x, y], (2, 2)."""
        half = self.spacing / 2 * np.array([np.sin(self.heading), -np.cos(self.heading)])
        return np.array([self.p_WG[:2] - half, self.p_WG[:2] + half])


@dc.dataclass(frozen=True, eq=False)
class GateMap(Immutable):
    """The map of the track."""

    time: float = -1.0  #: of the newest image in it (s)
    markers: tuple[MarkerEstimate, ...] = ()  #: by ID
    gates: tuple[GateEstimate, ...] = ()  #: those whose two pylons are known, by number
    detections: int = 0  #: number of markers detected so far
    out_of_range: int = 0  #: how many of them had an impossible ID
    #: Why a marker, or what looked like one, did not enter the map, and how often.
    refused: dict = dc.field(default_factory=dict)

    @property
    def error_rate(self) -> float:
        """Share of the detections with an impossible ID."""
        return self.out_of_range / max(self.detections, 1)
