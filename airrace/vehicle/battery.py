"""The battery: how its voltage falls under load, and with what was taken from it."""

import dataclasses as dc
import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from airrace.vehicle.vehicle import Vehicle

_HOUR = 3600.0  # s


@dc.dataclass
class Battery:
    """A pack of cells, whose voltage the speeds that rotors can reach go with."""

    full: float = float("nan")  #: V without load when it is full: with it, rotors give max_thrust
    empty: float = float("nan")  #: V without load when nothing is left
    capacity: float = float("nan")  #: A h
    resistance: float = float("nan")  #: ohm, of cells and wires
    efficiency: float = 0.7  #: share of its power that arrives at the propellers
    heard: bool = True  #: whether the autonomy hears of the voltage, and commands accordingly

    def check(self) -> None:
        """Raises ValueError with one clause that says what is wrong."""
        numbers = self.full, self.empty, self.capacity, self.resistance, self.efficiency
        if not all(math.isfinite(x) and x > 0.0 for x in numbers):
            raise ValueError("all numbers of the battery must be positive")
        if self.empty > self.full:
            raise ValueError("its battery has a higher voltage when it is empty")
        if self.efficiency > 1.0:
            raise ValueError("the efficiency of its battery is above 1")


class Pack:
    """A battery in flight.

    Attributes:
        voltage: at its terminals (V).
        used: what was taken from it (A h).
    """

    def __init__(self, battery: Battery, vehicle: "Vehicle"):
        """Args: battery: full. vehicle: whose rotors it turns."""
        self._battery = battery
        self.voltage, self.used = battery.full, 0.0
        ratios = np.array([rotor.torque_ratio for rotor in vehicle.rotors])
        self._torques = ratios * vehicle.thrust_coefficients  # per squared speed (N m s^2)

    @property
    def supply(self) -> float:
        """The voltage as a share of the full battery's without load."""
        return self.voltage / self._battery.full

    def step(self, speeds: np.ndarray, period: float) -> None:
        """Turns rotors for a period (s). Args: speeds: of the rotors (rad/s), (n,)."""
        battery = self._battery
        power = float(self._torques @ np.abs(speeds) ** 3) / battery.efficiency
        share = min(self.used / battery.capacity, 1.0)
        unloaded = battery.full + share * (battery.empty - battery.full)
        # The current I that gives the power, I (unloaded - R I); at most what it can give at all.
        root = math.sqrt(max(unloaded**2 - 4.0 * battery.resistance * power, 0.0))
        current = (unloaded - root) / (2.0 * battery.resistance)
        self.voltage = unloaded - battery.resistance * current
        self.used += current * period / _HOUR
