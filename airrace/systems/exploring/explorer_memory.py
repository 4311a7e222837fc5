"""The state of the explorer."""

import dataclasses as dc

import numpy as np

from airrace.common.immutable import Immutable
from airrace.systems.types import ExplorerEvent, ExplorerStatus
from airrace.trajopt.flat_trajectory import FlatTrajectory


@dc.dataclass(frozen=True, eq=False)
class Memory(Immutable):
    """What the explorer remembers.

    Attributes:
        status: what the world may know.
        leg, leg_start: trajectory being flown and when it started (s).
        home: hover pose over the start: x, y, z and yaw, (4,).
        aligned: whether the heading was checked against gate 1.
        last: newest gate of the list, a GateEstimate, or None.
        ahead: gates on the leg, as they were when it was planned, and the times
            on it at which they are passed.
        steps, arounds: of the search for the next gate so far, see search.py.
        checked: when the leg was last checked against the map (s).
        blocked: when no way to a gate that was found was free (s).
    """

    status: ExplorerStatus
    leg: FlatTrajectory | None = None
    leg_start: float = 0.0
    home: np.ndarray | None = None
    aligned: bool = False
    last: object = None
    ahead: tuple = ()
    steps: int = 0
    arounds: int = 0
    checked: float = 0.0
    blocked: float = -np.inf

    @property
    def goal(self) -> np.ndarray:
        """Where the leg ends: x, y, z and yaw, (4,)."""
        return self.leg.derivatives(self.leg.duration, 1)[0]

    @property
    def leg_end(self) -> float:
        """When the leg ends (s)."""
        return self.leg_start + self.leg.duration

    def entered(self, time: float, state: str, reason: str, **changes) -> "Memory":
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

    def behind(self, time: float) -> "Memory":
        """Returns the memory without the gates that were passed by a time (s)."""
        ahead = tuple(pair for pair in self.ahead if self.leg_start + pair[1] > time)
        return self if len(ahead) == len(self.ahead) else dc.replace(self, ahead=ahead)

    def flying(self, leg: FlatTrajectory, time: float) -> "Memory":
        """Returns the memory of a leg that starts at a time (s)."""
        return dc.replace(self, leg=leg, leg_start=time, checked=time)


def first_memory() -> Memory:
    """Returns the memory of a drone that was just switched on."""
    return Memory(ExplorerStatus(events=(ExplorerEvent(0.0, "CALIBRATE", "power on"),)))
