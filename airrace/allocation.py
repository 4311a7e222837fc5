"""From a commanded wrench to rotor thrusts within their limits."""

import numpy as np


class Allocator:
    """Distributes thrust and moments over the rotors of a vehicle.

    Within the limits it is the Moore-Penrose pseudo-inverse. At a limit it
    gives up yaw first, then total thrust, and keeps roll and pitch, which
    hold the drone up.
    """

    def __init__(self, allocation: np.ndarray, max_thrusts: np.ndarray):
        """Args: allocation: (4, n), see Vehicle. max_thrusts: (n,) in N."""
        self._inverse = np.linalg.pinv(allocation)
        self._max = max_thrusts

    def allocate(self, wrench: np.ndarray) -> np.ndarray:
        """Returns the thrusts (n,) for a wrench [f, Mx, My, Mz], shape (4,)."""
        thrusts = self._inverse @ wrench
        if thrusts.min() >= 0.0 and (thrusts <= self._max).all():
            return thrusts
        roll_pitch = self._inverse[:, 1:3] @ wrench[1:3]
        collective = self._inverse[:, 0] * wrench[0]
        yaw = self._inverse[:, 3] * wrench[3]
        # The largest share of yaw in [0, 1] that fits beside the rest.
        room = np.where(yaw > 0, self._max - collective - roll_pitch, collective + roll_pitch)
        room = np.maximum(room, 0.0)
        tight = np.abs(yaw) > room
        share = (room[tight] / np.abs(yaw[tight])).min(initial=1.0)
        rest = roll_pitch + share * yaw
        # Then the collective moves to where all rotors fit, if they can.
        low, high = -rest.min(), (self._max - rest).min()
        shift = np.clip(wrench[0] / len(rest), min(low, high), max(low, high))
        return np.clip(rest + shift, 0.0, self._max)
