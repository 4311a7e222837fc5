"""How a drone comes down that does not know any more where it is."""

import dataclasses as dc
import math

import numpy as np

from airrace.common.immutable import Immutable
from airrace.systems.control.command_watchdog import (
    AIRBORNE,
    BRAKE,
    HOVER,
    LAND,
    WatchdogMemory,
    stopping,
)
from airrace.systems.exploring.exploration import hover_pose
from airrace.vehicle.state import as_state


@dc.dataclass(frozen=True)
class Landing(Immutable):
    """Brakes in the direction of flight, and descends on the spot.

    As the watchdog of a flight controller does it, see stopping(). It stands where a trajectory
    stands otherwise.

    Attributes:
        start: pose and velocity at the beginning.
        braked: how long the drone brakes (s).
    """

    start: WatchdogMemory
    braked: float

    @classmethod
    def of(cls, estimate: np.ndarray, pad: float) -> "Landing":
        """Returns the landing that begins in a state; on the pad, the rotors idle.

        Args:
            estimate: of the state, see vehicle/state.py, (14,).
            pad: height of the drone when it stands there (m).
        """
        x, y, z, yaw = hover_pose(estimate)
        vx, vy, vz = as_state(estimate).velocity
        braked = math.hypot(vx, vy, vz) / BRAKE
        memory = WatchdogMemory(
            x=x,
            y=y,
            z=z,
            yaw=yaw,
            vx=vx,
            vy=vy,
            vz=vz,
            airborne=float(z > pad + AIRBORNE),
            landing=braked,
        )
        return cls(memory, braked)

    def reference(self, time: float) -> np.ndarray:
        """Returns the sample at a time since the beginning (s), a Reference as a vector, (18,)."""
        mode = LAND if time >= self.braked else HOVER
        return stopping(self.start._replace(mode=mode), time)
