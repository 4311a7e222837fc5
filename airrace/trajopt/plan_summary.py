"""What a planned lap promises, and whether it holds at 1 kHz."""

import dataclasses as dc

import numpy as np

from airrace.common.immutable import Immutable
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.flatness import inverse_dynamics
from airrace.trajopt.flight_limits import FlightLimits
from airrace.trajopt.flyable import pylon_distances
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.min_snap.circuit import Circuit
from airrace.trajopt.reference import as_reference
from airrace.vehicle import GRAVITY

_RATE = 1000.0  # Hz
_REACHED = 0.98  # of a limit: laps leave a little for the ways onto them


@dc.dataclass(frozen=True, eq=False)
class FlightCheck(Immutable):
    """The extremes of a lap, by inverse dynamics at 1 kHz.

    Attributes:
        max_speed: (m/s). max_acceleration: without gravity (m/s^2).
        max_rate: of the body's angular velocity (rad/s).
        max_thrusts, min_thrusts: of every rotor (N), tuples.
        min_height: above the ground (m).
        clearance: from the nearest pylon's axis (m).
        max_bearing: of the next gate's midpoint, off the heading (rad), where it is
            farther than `least_range`.
        excess: the largest of all limited quantities over its limit, less one; at
            most zero if the limits are kept.
        reached: names of the limits that are used to the full.
    """

    max_speed: float
    max_acceleration: float
    max_rate: float
    max_thrusts: tuple
    min_thrusts: tuple
    min_height: float
    clearance: float
    max_bearing: float
    excess: float
    reached: tuple


@dc.dataclass(frozen=True, eq=False)
class LapReport(Immutable):
    """How a lap was found and what it promises.

    Attributes:
        duration: of the lap (s).
        bound: of a point mass with the same limits through the same gates, and as far from
            the pylons (s).
        check: of the lap as planned.
        solver: name. iterations: of convex programs. solve_time: of wall clock (s).
        warm: whether it started from another lap.
    """

    duration: float
    bound: float
    check: FlightCheck
    solver: str
    iterations: int
    solve_time: float
    warm: bool

    @property
    def gap(self) -> float:
        """How much longer than the bound, as a share of it."""
        return self.duration / self.bound - 1.0


def check_lap(
    lap: Circuit, gates: GateRegions, pylons, limits: FlightLimits, least_range: float
) -> FlightCheck:
    """Checks a lap from its flat outputs alone.

    Args:
        lap: to check.
        gates, limits: see there.
        pylons: axes, [x, y], (m, 2) m.
        least_range: see FlightCheck.max_bearing (m).
    """
    times = check_times(lap)
    samples = lap.sample(times)
    bearing = _max_bearing(samples, times, lap.gate_times, gates, least_range)
    return check_flight(samples, pylons, limits, bearing)


def check_times(trajectory: FlatTrajectory) -> np.ndarray:
    """Returns the times of a check at 1 kHz, both ends included (s)."""
    duration = trajectory.duration
    return np.linspace(0.0, duration, int(np.ceil(_RATE * duration)) + 1)


def check_flight(samples, pylons, limits: FlightLimits, max_bearing: float = 0.0) -> FlightCheck:
    """Checks samples of a flight.

    Args:
        samples: as in trajopt/reference.py, (18, N).
        pylons: axes, [x, y], (m, 2) m.
        limits: to keep.
        max_bearing: see FlightCheck.
    """
    thrusts, w = inverse_dynamics(samples, limits.vehicle, GRAVITY, limits.drag)
    most = limits.max_thrusts[:, None]
    speed = float(np.linalg.norm(as_reference(samples).velocity, axis=0).max())
    acceleration = float(np.linalg.norm(as_reference(samples).acceleration, axis=0).max())
    rate = float(np.linalg.norm(w, axis=0).max())
    shares = {
        "speed": speed / limits.max_speed,
        "acceleration": acceleration / limits.max_acceleration,
        "rate": rate / limits.max_rate,
        "thrust": float((thrusts / most).max()),
        "idle": 1.0 - float(((thrusts - limits.min_thrusts[:, None]) / most).min()),
    }
    return FlightCheck(
        max_speed=speed,
        max_acceleration=acceleration,
        max_rate=rate,
        max_thrusts=tuple(thrusts.max(axis=1).tolist()),
        min_thrusts=tuple(thrusts.min(axis=1).tolist()),
        min_height=float(samples[2].min()),
        clearance=float(pylon_distances(samples, pylons).min(initial=np.inf)),
        max_bearing=max_bearing,
        excess=max(shares.values()) - 1.0,
        reached=tuple(name for name, share in shares.items() if share > _REACHED),
    )


def _max_bearing(samples, times, gate_times, gates, least_range) -> float:
    following = np.searchsorted(gate_times, times, side="right") % len(gates.midpoints)
    to_gate = gates.midpoints[following].T[:2] - as_reference(samples).position[:2]
    off = np.arctan2(to_gate[1], to_gate[0]) - as_reference(samples).yaw
    off = np.abs((off + np.pi) % (2 * np.pi) - np.pi)
    return float(off[np.linalg.norm(to_gate, axis=0) > least_range].max(initial=0.0))
