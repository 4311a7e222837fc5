"""What is left of a vehicle that has lost rotors."""

import numpy as np
from numpy.typing import ArrayLike

from airrace.vehicle.allocation import Allocator, wrench_margin
from airrace.vehicle.vehicle import GRAVITY, Vehicle

# Of what the rotors can do, see wrench_margin: to hold a hover, it takes some.
_LEAST_MARGIN = 0.01


class Remaining:
    """The rotors that still work, and what they can do.

    Attributes:
        can_hold_level: whether they can hover and hold roll and pitch.
        can_fly: whether they can also hold the yaw: then the vehicle flies on.
        allocator: over them; without yaw if they cannot hold it.
        max_thrusts: (n,) in N, zero for the lost.
        max_lift: the greatest thrust without a moment (N).
    """

    def __init__(self, vehicle: Vehicle, working: ArrayLike):
        """Args: vehicle: when whole. working: n booleans."""
        self.max_thrusts = vehicle.max_thrusts * np.array(working)
        weight = vehicle.mass * GRAVITY
        B = vehicle.allocation
        self.can_hold_level = _holds(B[:3], self.max_thrusts, weight)
        self.can_fly = _holds(B, self.max_thrusts, weight)
        self.allocator = Allocator(B, self.max_thrusts, yaw=self.can_fly)
        most = np.array([self.max_thrusts.sum(), 0.0, 0.0, 0.0])
        self.max_lift = float(self.allocator.allocate(most).sum())


def _holds(allocation: np.ndarray, max_thrusts: np.ndarray, weight: float) -> bool:
    hover = weight * np.eye(len(allocation))[0]
    return bool(wrench_margin(allocation, max_thrusts, hover) > _LEAST_MARGIN)
