"""How a drone stops that nobody leads any more: it brakes, hovers, and comes down on the spot."""

import dataclasses as dc
import math
from typing import NamedTuple

import numpy as np

from airrace.common.immutable import Immutable
from airrace.math.quaternion import reference_yaw
from airrace.trajopt.flat_trajectory import hold, idle
from airrace.trajopt.reference import as_reference
from airrace.vehicle.state import as_state

AIRBORNE = 0.4  # m over where it stood
_BRAKE = 6.0  # m/s^2, before the hover
_DESCENT, _LAST_DESCENT = 2.0, 0.5  # m/s, and over the last metre
_QUICKENING = 0.1  # m/s^2, beneath the ground: whoever is still in the air has a wrong height
LOW = 1.0  # m over the ground; from there it sinks slowly


class Stop(NamedTuple):
    """A stop, by the state in which it begins."""

    position: np.ndarray  #: p_WB (m), (3,)
    yaw: float  #: of the attitude, see reference_yaw() (rad)
    velocity: np.ndarray  #: v_WB (m/s), (3,)
    airborne: bool = True  #: whether it has taken off; if not, its rotors idle

    @classmethod
    def of(cls, estimate: np.ndarray, pad: float) -> "Stop":
        """Returns the stop that begins in a state.

        Args:
            estimate: of the state, see vehicle/state.py, (14,).
            pad: height of the drone when it stands there (m).
        """
        state = as_state(estimate)
        airborne = bool(state.position[2] > pad + AIRBORNE)
        yaw = reference_yaw(state.quaternion)
        return cls(state.position.copy(), yaw, state.velocity.copy(), airborne)

    @property
    def braking_time(self) -> float:
        """How long it brakes (s)."""
        return math.hypot(*self.velocity) / _BRAKE

    @property
    def braking_distance(self) -> np.ndarray:
        """How far it comes (m), (3,)."""
        return self.velocity * (self.braking_time / 2)

    def reference(self, elapsed: float, sinking: float | None = None) -> np.ndarray:
        """Returns the sample at a time, a Reference as a vector, (18,).

        The drone brakes evenly in the direction of flight, stays there, and descends if it is to
        land: fast down to the last metre, slowly on. If the ground does not come where it should
        be, the estimate believes that the drone sinks faster than it does, and more so with time:
        so it sinks ever faster.

        Args:
            elapsed: since the beginning (s).
            sinking: since it began to descend (s); None: it does not.
        """
        if not self.airborne:
            return idle(self.position, self.yaw)
        speed = math.hypot(*self.velocity)
        direction = self.velocity / max(speed, 1e-9)
        t = min(elapsed, speed / _BRAKE)
        way = (speed * t - _BRAKE * t * t / 2) * direction
        result = hold(self.position + way, self.yaw)
        reference = as_reference(result)
        if elapsed < speed / _BRAKE:
            reference.velocity[:] = (speed - _BRAKE * t) * direction
            reference.acceleration[:] = -_BRAKE * direction
        if sinking is not None:
            height, rate = _descended(reference.position[2], sinking)
            reference.position[2] = height
            reference.velocity[2] -= rate
        return result


def _descended(height: float, elapsed: float) -> tuple[float, float]:
    """Returns height (m) and rate of descent (m/s) a time after a descent from a height began."""
    low = min(height, LOW)
    fast = (height - low) / _DESCENT
    if elapsed < fast:
        return height - _DESCENT * elapsed, _DESCENT
    slow = elapsed - fast
    beneath = max(slow - max(low, 0.0) / _LAST_DESCENT, 0.0)
    rate = _LAST_DESCENT + _QUICKENING * beneath
    return low - _LAST_DESCENT * slow - _QUICKENING * beneath**2 / 2, rate


@dc.dataclass(frozen=True)
class Landing(Immutable):
    """Brakes in the direction of flight, and descends on the spot.

    It stands where a trajectory stands otherwise.
    """

    stop: Stop  #: from the state at the beginning

    def reference(self, time: float) -> np.ndarray:
        """Returns the sample at a time since the beginning (s), a Reference as a vector, (18,)."""
        braked = self.stop.braking_time
        return self.stop.reference(time, time - braked if time >= braked else None)
