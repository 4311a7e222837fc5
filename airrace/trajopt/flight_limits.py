"""What a flight must keep: the limits of the vehicle, those that a team adds, and pylons."""

import dataclasses as dc
import functools
from collections.abc import Mapping

import numpy as np

from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.vehicle import GRAVITY, Vehicle
from airrace.vehicle.air import STILL, Air

_SCALED = "thrust_share", "max_speed", "max_acceleration", "max_rate"
MIN_HEIGHT = 1.0  # m


@dc.dataclass(frozen=True, eq=False)
class FlightLimits:
    """Limits of a flight."""

    vehicle: Vehicle  #: each rotor's thrust must lie between zero and its limit
    #: Of the rotors' limits, that may be used at most; the rest is left to the controller.
    thrust_share: float = 1.0
    idle_share: float = 0.0  #: likewise, at least
    max_speed: float = np.inf  #: m/s
    max_acceleration: float = np.inf  #: without gravity (m/s^2)
    max_rate: float = 20.0  #: of the body's angular velocity, its norm (rad/s)
    max_axis_rates: tuple = (np.inf,) * 3  #: besides, about each of the body's axes (rad/s)
    #: Vertical component of the thrust over mass (m/s^2); the drone never points down, and a
    #: heading always has a meaning. -inf for a drone that may fly upside down.
    min_lift: float = 0.5 * GRAVITY
    air: Air = STILL  #: that the vehicle flies through

    def scaled(self, share: float) -> "FlightLimits":
        """Returns limits of which a share is left, from below as well for rotors."""
        scaled = {name: share * getattr(self, name) for name in _SCALED}
        rates = tuple(share * rate for rate in self.max_axis_rates)
        idle_share = self.idle_share + (1.0 - share)
        return dc.replace(self, idle_share=idle_share, max_axis_rates=rates, **scaled)

    def tightened(self, excesses: Mapping[str, float]) -> "FlightLimits":
        """Returns limits that are less by what a flight exceeds each, see LapSamples.excesses()."""
        factor = {name: 1.0 - max(excess, 0.0) for name, excess in excesses.items()}
        return dc.replace(
            self,
            idle_share=self.idle_share + (1.0 - factor["idle_share"]) * self.thrust_share,
            max_axis_rates=tuple(factor["max_axis_rates"] * rate for rate in self.max_axis_rates),
            **{name: factor[name] * getattr(self, name) for name in _SCALED},
        )

    def check(self) -> None:
        """Raises TrajectoryOptimizationError if nothing can fly within them."""
        for name in _SCALED:
            if not getattr(self, name) > 0.0:
                raise TrajectoryOptimizationError(
                    f"{name} must be positive, not {getattr(self, name)}."
                )
        if np.shape(self.max_axis_rates) != (3,) or not min(self.max_axis_rates) > 0.0:
            raise TrajectoryOptimizationError(
                f"max_axis_rates must be three positive numbers, not {self.max_axis_rates}."
            )
        if not self.idle_share >= 0.0 or np.isnan(self.min_lift):
            raise TrajectoryOptimizationError(
                "idle_share must not be negative, and min_lift be a number."
            )
        hover = self.from_wrench[:, 0] * self.vehicle.mass * GRAVITY
        if np.any(hover >= self.max_thrusts):
            raise TrajectoryOptimizationError(
                f"At {self.thrust_share:.0%} of their limits, the rotors of {self.vehicle.name} "
                "cannot hold a hover."
            )
        if np.any(hover <= self.min_thrusts):
            raise TrajectoryOptimizationError(
                f"At {self.idle_share:.0%} of their limits, which they must keep, the rotors of "
                f"{self.vehicle.name} lift more than its weight."
            )

    @functools.cached_property
    def from_wrench(self) -> np.ndarray:
        """The rotors' thrusts for [f, Mx, My, Mz] in B, by the pseudo-inverse, (rotors, 4)."""
        return np.linalg.pinv(self.vehicle.allocation)

    @property
    def max_thrusts(self) -> np.ndarray:
        """Of the rotors, (rotors,) N."""
        return self.thrust_share * self.vehicle.max_thrusts

    @property
    def min_thrusts(self) -> np.ndarray:
        """Of the rotors, (rotors,) N."""
        return self.idle_share * self.vehicle.max_thrusts

    @property
    def max_specific_force(self) -> float:
        """The greatest thrust over mass of all rotors together (m/s^2)."""
        return float(self.max_thrusts.sum() / self.vehicle.mass)


@dc.dataclass(frozen=True, eq=False)
class FlightConstraints:
    """What a flight must keep."""

    pylons: np.ndarray  #: axes to keep clear of, [x, y], (m, 2) m
    clearance: float | np.ndarray  #: from those, a number or (m,) m
    limits: FlightLimits  #: of the vehicle, and those added
    #: Angle off the heading within which a time-optimal flight keeps the midpoint of the next gate
    #: until it is near (rad); pi, the most, if it need not be seen.
    half_view: float = np.deg2rad(40.0)
    min_height: float = MIN_HEIGHT  #: (m)

    def check(self) -> None:
        """Raises TrajectoryOptimizationError if nothing can fly within them."""
        self.limits.check()
        pylons = np.asarray(self.pylons, float)
        if pylons.size and pylons.shape[1:] != (2,) or not np.isfinite(pylons).all():
            raise TrajectoryOptimizationError("A pylon's place is not two finite numbers.")
        if np.shape(self.clearance) not in ((), (len(pylons),)):
            raise TrajectoryOptimizationError(
                f"clearance must be one number, or one for each of {len(pylons)} pylons."
            )
        if np.isnan(self.min_height) or not np.all(np.asarray(self.clearance) >= 0.0):
            raise TrajectoryOptimizationError(
                "min_height must be a number, and clearance one that is not negative."
            )
        if not 0.0 < self.half_view <= np.pi:
            raise TrajectoryOptimizationError(
                "half_view must be positive, and 180 degrees at most."
            )
