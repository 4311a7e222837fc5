"""All gates of a track as arrays in the plane, for rules and plots."""

import dataclasses as dc
import functools

import numpy as np

from airrace.math.angles import wrap_angle
from airrace.track.course import Course
from airrace.track.geometry import directions


@dc.dataclass(frozen=True, eq=False)
class Layout:
    """A track in the plane. Leg i leads from gate i to the next, the last to gate 0."""

    left: np.ndarray  #: left pylons, (n, 2) m
    headings: np.ndarray  #: directions of flight through the gates, (n,) rad
    spacing: np.ndarray  #: between the pylons of a gate, (n,) m

    @classmethod
    def of(cls, track: Course) -> "Layout":
        """Returns the layout of a course: of frames, the sides are in the place of pylons."""
        return cls(
            np.array([gate.p_WL[:2] for gate in track.gates]),
            np.array([gate.heading for gate in track.gates]),
            np.array([gate.width for gate in track.gates]),
        )

    @functools.cached_property
    def forward(self) -> np.ndarray:
        """Unit vectors of flight through the gates, (n, 2)."""
        return directions(self.headings)

    @functools.cached_property
    def rightward(self) -> np.ndarray:
        """Unit vectors from the left to the right pylons, (n, 2)."""
        return self.forward[:, ::-1] * [1.0, -1.0]

    @functools.cached_property
    def right(self) -> np.ndarray:
        """Right pylons, (n, 2) m."""
        return self.left + self.spacing[:, None] * self.rightward

    @functools.cached_property
    def middle(self) -> np.ndarray:
        """Midpoints of the gates, (n, 2) m."""
        return (self.left + self.right) / 2

    @functools.cached_property
    def pylons(self) -> np.ndarray:
        """Left and right pylon of each gate, (n, 2, 2) m."""
        return np.stack([self.left, self.right], axis=1)

    @functools.cached_property
    def turns(self) -> np.ndarray:
        """Change of heading on each leg, in -pi to pi, left positive, (n,) rad."""
        return wrap_angle(np.roll(self.headings, -1) - self.headings)

    @functools.cached_property
    def lengths(self) -> np.ndarray:
        """From each left pylon to the next along the direction of flight, (n,) m."""
        return np.sum((np.roll(self.left, -1, axis=0) - self.left) * self.forward, axis=1)

    @functools.cached_property
    def straight_ends(self) -> np.ndarray:
        """Where the straight line forward from a midpoint meets the next gate, (n, 2) m."""
        following = np.roll(self.forward, -1, axis=0)
        to_gate = np.roll(self.middle, -1, axis=0) - self.middle
        along = np.sum(to_gate * following, axis=1) / np.sum(self.forward * following, axis=1)
        return self.middle + along[:, None] * self.forward
