"""The values that cross abstract ports: frozen, and shared instead of copied."""

import dataclasses as dc

import numpy as np
from pydrake.math import RigidTransform

from airrace.common.immutable import Immutable


@dc.dataclass(frozen=True, eq=False)
class Detection(Immutable):
    """One marker in one image.

    Attributes:
        id: the ArUco ID.
        corners: of the black square in pixels, top left first, clockwise as
            the marker is read, (4, 2).
        X_CM: pose of the marker frame in the camera frame.
        reprojection_error: RMS distance of the corners from the projection
            of X_CM (px).
        covariance: of X_CM, (6, 6): first of its rotation as a rotation
            vector in C (rad), then of its position in C (m). None if unknown.
        joint: whether X_CM was solved together with that of the marker on the
            other pylon of the gate. The errors of the two are then those of
            one rigid body: count their mean once, not as two.
        ambiguity: misfit of X_CM divided by that of the other pose that a planar
            marker admits, 0 to 1: near 1 the poses are hard to tell apart, and the
            rotation may be the wrong one. 0 if there is no other.
        corner_sigma: standard deviation of a coordinate of a corner by the picture's noise
            (px), root mean square over the corners.
    """

    id: int
    corners: np.ndarray
    X_CM: RigidTransform
    reprojection_error: float
    covariance: np.ndarray | None = None
    joint: bool = False
    ambiguity: float = 0.0
    corner_sigma: float = 0.0

    @property
    def face(self) -> str:
        """Which face of its pylon the marker is on, "front" or "back"."""
        return "back" if self.id % 2 else "front"


@dc.dataclass(frozen=True, eq=False)
class Detections(Immutable):
    """All markers found in one image.

    Attributes:
        time: when the image was taken (s).
        markers: tuple of Detection.
        refused: tuple of (reason, ID) of what looked like a marker and was not
            taken for one; the ID is None if the reason is the whole image.
    """

    time: float = -1.0
    markers: tuple = ()
    refused: tuple = ()


@dc.dataclass(frozen=True, eq=False)
class ExplorerEvent(Immutable):
    """A change of the explorer's state.

    Attributes:
        time: when (s).
        state: name of the state that was entered.
        reason: why.
    """

    time: float
    state: str
    reason: str


LAND = "LAND"  # the state of an explorer that lands because the drone does not know where it is


@dc.dataclass(frozen=True, eq=False)
class ExplorerStatus(Immutable):
    """How far the exploration is.

    Attributes:
        state: name of the explorer's state.
        reason: why it was entered.
        since: when (s).
        gates: numbers of the gates found, in the order of flight.
        closed_at: when the loop was closed (s), None before.
        done: whether it is, and the drone is ready to race.
        events: tuple of ExplorerEvent, all changes of state so far, the last
            of which is the present state.
    """

    state: str = "CALIBRATE"
    reason: str = "power on"
    since: float = 0.0
    gates: tuple = ()
    closed_at: float | None = None
    done: bool = False
    events: tuple = ()


@dc.dataclass(frozen=True, eq=False)
class PolicyStatus(Immutable):
    """Whether a policy flies: see PolicyController.

    Attributes:
        flies: whether the network does.
        since: when it took over, or handed back (s).
        reason: why it has handed back to the planner; empty before.
        planner_may_plan: whether it has, and the drone hovers again.
        passed: number of gates that the network has passed.
    """

    flies: bool = False
    since: float = 0.0
    reason: str = ""
    planner_may_plan: bool = False
    passed: int = 0


@dc.dataclass(frozen=True)
class GateCrossing:
    """One gate flown through in order.

    Attributes:
        time: of the crossing, interpolated between two updates (s).
        gate: number of the gate, from 1.
        lap: number of the lap that this crossing belongs to, from 1; gate 1
            belongs to the lap that it starts.
        offset: distance of the crossing from the gate's midpoint (m).
        max_speed: since the crossing before (m/s).
    """

    time: float
    gate: int
    lap: int
    offset: float
    max_speed: float


@dc.dataclass(frozen=True)
class RefereeStatus(Immutable):
    """The race so far.

    Attributes:
        crossings: all counted crossings in order; the one after the last
            lap's last gate closes that lap.
        finished: whether all laps are flown.
        dnf_reason: why the race ended before that, or None.
        end_time: of either (s), or None.
        collisions: number of contacts that the race ended with (0 or 1).
    """

    crossings: tuple
    finished: bool
    dnf_reason: str | None
    end_time: float | None
    collisions: int

    @property
    def over(self) -> bool:
        """Whether the race has ended."""
        return self.end_time is not None
