"""What happens in a race, as a stream of events and samples.

A RaceObserver makes it while a race is flown, analysis/recorded_events.py reads it back from
race.mcap. A sink is a function of one event: it writes race.mcap, race.json, the page, or lines of
the terminal.
"""

import dataclasses as dc
from collections.abc import Callable

import numpy as np
from pydrake.math import RigidTransform

from airrace.systems.estimation.slam_filter import SlamState
from airrace.systems.planning.lap_plan import LapPlan
from airrace.systems.sensing.camera_view import CameraView
from airrace.systems.types import (
    Detections,
    ExplorerEvent,
    ExplorerStatus,
    GateCrossing,
    PolicyStatus,
    RefereeStatus,
)
from airrace.track.gate_map import GateMap
from airrace.trajopt.reference import Reference
from airrace.vehicle.camera_info import CameraInfo
from airrace.vehicle.state import State

DRONE = "drone"  # name of the only one


@dc.dataclass(frozen=True, eq=False)
class RaceEvent:
    """What was seen at a time (s), the same as when it happened or a little later."""

    time: float


Sink = Callable[[RaceEvent], object]


@dc.dataclass(frozen=True, eq=False)
class GatesMoved(RaceEvent):
    """Gates stand elsewhere, or for the first time somewhere, in a race whose gates move."""

    shifts: np.ndarray  #: from their places in the track's file, x and y of each (m, world), (2 n,)


@dc.dataclass(frozen=True, eq=False)
class DroneEvent(RaceEvent):
    """What is of one drone, which has a name."""

    drone: str = dc.field(default=DRONE, kw_only=True)


@dc.dataclass(frozen=True, eq=False)
class StateSample(DroneEvent):
    """Where the drone is, where it should be, and what its rotors do; None is not known."""

    truth: State  #: in the simulation
    estimate: State | None = None  #: as the autopilot hands it to the autonomy
    filtered: State | None = None  #: as the controller uses it; all zero before the first
    #: Acceleration that rotors and gravity do not explain (m/s^2, world), (3,).
    disturbance: np.ndarray | None = None
    imu: np.ndarray | None = None  #: newest samples of the IMU, see as_samples()
    reference: Reference | None = None  #: what the controller follows
    #: rotor_speeds, rotor_commands: measured and commanded (rad/s), (n,)
    rotor_speeds: np.ndarray | None = None
    rotor_commands: np.ndarray | None = None


@dc.dataclass(frozen=True, eq=False)
class PoseSample(DroneEvent):
    """Where the drone is, and its camera on it."""

    truth: State
    X_BC: RigidTransform


@dc.dataclass(frozen=True, eq=False)
class ImuSampled(DroneEvent):
    """Samples of the IMU that are new."""

    #: Oldest first, (n, 7): time (s), angular velocity (rad/s), specific force (m/s^2).
    samples: np.ndarray


@dc.dataclass(frozen=True, eq=False)
class Picture(DroneEvent):
    """A picture of the camera, which is drawn only if somebody reads it."""

    taken: float  #: when (s)
    view: CameraView
    info: CameraInfo


@dc.dataclass(frozen=True, eq=False)
class DetectionsSeen(DroneEvent):
    """The markers that were found in a picture."""

    detections: Detections


@dc.dataclass(frozen=True, eq=False)
class EstimateMade(DroneEvent):
    """What an estimator believes after a picture."""

    #: Of attitude, position and velocity now, see estimate_error(); NaN if not known, (9,).
    error: np.ndarray
    #: Of these three at the time of the picture, in single precision, (9, 9).
    covariance: np.ndarray
    slam: SlamState | None = None  #: all that it believes; None if this was read from a log


@dc.dataclass(frozen=True, eq=False)
class MapChanged(DroneEvent):
    """The drone's map of the track is another one."""

    gate_map: GateMap


@dc.dataclass(frozen=True, eq=False)
class PlanMade(DroneEvent):
    """The drone has a new plan of laps."""

    plan: LapPlan


@dc.dataclass(frozen=True, eq=False)
class ClockWaits(DroneEvent):
    """The clock of plans waits for the drone, or has waited; see PathGovernor."""

    delay: float  #: of plans, all in all (s)
    goes_on: bool  #: whether it still waits


@dc.dataclass(frozen=True, eq=False)
class ExplorerChanged(DroneEvent):
    """The explorer has got further."""

    status: ExplorerStatus
    entered: tuple[ExplorerEvent, ...]  #: the states since the event before


@dc.dataclass(frozen=True, eq=False)
class PolicyChanged(DroneEvent):
    """A policy took over, or handed back."""

    status: PolicyStatus

    @property
    def what(self) -> str:
        """What happened, in words."""
        if self.status.reason:
            return f"the planner flies: {self.status.reason}"
        return "the network flies"


@dc.dataclass(frozen=True, eq=False)
class RotorLost(DroneEvent):
    """The autonomy has noticed that a rotor is lost."""

    rotor: int  #: from 1
    noticed: float  #: when (s)


@dc.dataclass(frozen=True, eq=False)
class NegativeThrusts(DroneEvent):
    """A controller of the scenario's own has asked for negative thrusts again; see OwnWrench."""

    number: int  #: so far


@dc.dataclass(frozen=True, eq=False)
class ContactsCounted(DroneEvent):
    """How many samples so far had a contact with gates, and with the environment."""

    gates: int
    environment: int


@dc.dataclass(frozen=True, eq=False)
class GateCrossed(DroneEvent):
    """The drone has flown through the next gate."""

    crossing: GateCrossing


@dc.dataclass(frozen=True, eq=False)
class RaceOver(DroneEvent):
    """The referee has ended the race."""

    status: RefereeStatus
