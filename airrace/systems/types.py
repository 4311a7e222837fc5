"""The values that cross abstract ports: frozen, and shared instead of copied."""

import dataclasses as dc

import numpy as np
from pydrake.math import RigidTransform

from airrace.common.immutable import Immutable


@dc.dataclass(frozen=True, eq=False)
class Detection(Immutable):
    """One marker in one image."""

    id: int  #: the ArUco ID
    #: Of the black square in pixels, top left first, clockwise as the marker is read, (4, 2).
    corners: np.ndarray
    X_CM: RigidTransform  #: pose of the marker frame in the camera frame
    reprojection_error: float  #: RMS distance of the corners from the projection of X_CM (px)
    #: Of X_CM, (6, 6): first of its rotation as a rotation vector in C (rad), then of its position
    #: in C (m). None if unknown.
    covariance: np.ndarray | None = None
    #: Whether X_CM was solved together with that of the marker on the other pylon of the gate. The
    #: errors of the two are then those of one rigid body: count their mean once, not as two.
    joint: bool = False
    #: Misfit of X_CM divided by that of the other pose that a planar marker admits, 0 to 1: near 1
    #: the poses are hard to tell apart, and the rotation may be the wrong one. 0 if there is no
    #: other.
    ambiguity: float = 0.0
    #: Standard deviation of a coordinate of a corner by the picture's noise (px), root mean square
    #: over the corners.
    corner_sigma: float = 0.0

    @property
    def face(self) -> str:
        """Which face of its pylon the marker is on, "front" or "back"."""
        return "back" if self.id % 2 else "front"


@dc.dataclass(frozen=True, eq=False)
class Detections(Immutable):
    """All markers found in one image."""

    time: float = -1.0  #: when the image was taken (s)
    markers: tuple[Detection, ...] = ()
    #: Tuple of (reason, ID) of what looked like a marker and was not taken for one; the ID is None
    #: if the reason is the whole image.
    refused: tuple = ()


@dc.dataclass(frozen=True, eq=False)
class ExplorerEvent(Immutable):
    """A change of the explorer's state."""

    time: float  #: when (s)
    state: str  #: name of the state that was entered
    reason: str  #: why


LAND = "LAND"  # the state of an explorer that lands because the drone does not know where it is


@dc.dataclass(frozen=True, eq=False)
class ExplorerStatus(Immutable):
    """How far the exploration is."""

    state: str = "CALIBRATE"  #: name of the explorer's state
    reason: str = "power on"  #: why it was entered
    since: float = 0.0  #: when (s)
    gates: tuple[int, ...] = ()  #: numbers of the gates found, in the order of flight
    closed_at: float | None = None  #: when the loop was closed (s), None before
    done: bool = False  #: whether it is, and the drone is ready to race
    #: All changes of state so far, the last of which is the present state.
    events: tuple[ExplorerEvent, ...] = ()


@dc.dataclass(frozen=True, eq=False)
class PolicyStatus(Immutable):
    """Whether a policy flies: see PolicyController."""

    flies: bool = False  #: whether the network does
    since: float = 0.0  #: when it took over, or handed back (s)
    reason: str = ""  #: why it has handed back to the planner; empty before
    planner_may_plan: bool = False  #: whether it has, and the drone hovers again
    passed: int = 0  #: number of gates that the network has passed


@dc.dataclass(frozen=True)
class GateCrossing:
    """One gate flown through in order."""

    time: float  #: of the crossing, interpolated between two updates (s)
    gate: int  #: number of the gate, from 1
    #: Number of the lap that this crossing belongs to, from 1; gate 1 belongs to the lap that it
    #: starts.
    lap: int
    offset: float  #: distance of the crossing from the gate's midpoint (m)
    max_speed: float  #: since the crossing before (m/s)


@dc.dataclass(frozen=True)
class RefereeStatus(Immutable):
    """The race so far."""

    #: All counted crossings in order; the one after the last lap's last gate closes that lap.
    crossings: tuple
    finished: bool  #: whether all laps are flown
    dnf_reason: str | None  #: why the race ended before that, or None
    end_time: float | None  #: of either (s), or None
    collisions: int  #: number of contacts that the race ended with (0 or 1)

    @property
    def over(self) -> bool:
        """Whether the race has ended."""
        return self.end_time is not None
