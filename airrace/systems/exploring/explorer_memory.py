"""What the explorer remembers, and what else it knows at one tick."""

import dataclasses as dc
import functools
from typing import Any

import numpy as np

from airrace.common.immutable import Immutable, read_only
from airrace.systems.types import Detections, ExplorerEvent, ExplorerStatus
from airrace.track.gate_map import GateEstimate, GateMap
from airrace.trajopt.flat_trajectory import FlatTrajectory

_ON_PAD = FlatTrajectory.resting(np.zeros(4))  # wherever that is
_SWITCHED_ON = ExplorerStatus(events=(ExplorerEvent(0.0, "CALIBRATE", "power on"),))


@dc.dataclass(frozen=True, eq=False)
class Memory(Immutable):
    """The explorer's own state; by default that of a drone that was just switched on."""

    status: ExplorerStatus = _SWITCHED_ON  #: the output
    #: leg, leg_start: trajectory being flown, at last a Landing, and when it started (s). On the
    #: pad there is nothing to fly, until the status is no longer CALIBRATE.
    leg: FlatTrajectory = _ON_PAD
    leg_start: float = 0.0
    #: Hover pose over the start: x, y, z and yaw, (4,); on the pad infinitely far down.
    home: np.ndarray = dc.field(default_factory=lambda: read_only([0.0, 0.0, -np.inf, 0.0]))
    aligned: bool = False  #: whether the heading was checked against gate 1
    last: GateEstimate | None = None  #: newest gate of the list, None before the first
    #: Whether gate 1 was seen to close the loop while it was too late to turn home: it may be out
    #: of sight behind the gate that was being passed.
    closing: bool = False
    #: Pairs of a gate on the leg, as it was when the leg was planned, and the time on the leg at
    #: which it is passed (s).
    gates_ahead: tuple = ()
    #: steps, steps_around: of the search for the next gate so far, see search.py
    steps: int = 0
    steps_around: int = 0
    checked_at: float = 0.0  #: when the leg was last checked against the map (s)
    blocked_at: float = -np.inf  #: when no clear leg to the next gate or step was found (s)

    @property
    def goal(self) -> np.ndarray:
        """Where the leg ends: x, y, z and yaw, (4,)."""
        return self.leg.derivatives(self.leg.duration, 1)[0]

    @property
    def leg_end(self) -> float:
        """When the leg ends (s)."""
        return self.leg_start + self.leg.duration

    def entered(self, time: float, state: str, reason: str, **changes: Any) -> "Memory":
        """Returns the memory in another state.

        Args:
            time: of the change (s).
            state: the new one.
            reason: for it.
            changes: of other attributes of the status.
        """
        status = dc.replace(
            self.status,
            state=state,
            reason=reason,
            since=time,
            events=(*self.status.events, ExplorerEvent(time, state, reason)),
            **changes,
        )
        return dc.replace(self, status=status)

    def flying(self, leg: FlatTrajectory, time: float) -> "Memory":
        """Returns the memory of a leg that starts at a time (s)."""
        return dc.replace(self, leg=leg, leg_start=time, checked_at=time)


@dc.dataclass(frozen=True)
class Situation:
    """What the explorer knows at one tick."""

    memory: Memory  #: the explorer's own state
    time: float  #: s
    #: detections, gate_map, estimate: its inputs
    detections: Detections
    gate_map: GateMap
    estimate: np.ndarray
    fault: str = ""  #: why the estimate is of no use any more, empty while it is of use
    #: Standard deviation of the estimated position relative to the known gates (m).
    drift: float = 0.0

    @functools.cached_property
    def gates(self) -> dict:
        """The gates of the map by their numbers."""
        return {gate.number: gate for gate in self.gate_map.gates}

    @functools.cached_property
    def next_number(self) -> int:
        """The number of the gate that is searched for."""
        found = self.memory.status.gates
        return found[-1] + 1 if found else 0

    @functools.cached_property
    def last(self) -> GateEstimate | None:
        """The newest gate of the list as the map has it now, None before the first."""
        last = self.memory.last
        return last and self.gates.get(last.number, last)

    def remembering(self, **changes: Any) -> "Situation":
        """Returns the situation with changes of the memory."""
        return dc.replace(self, memory=dc.replace(self.memory, **changes))
