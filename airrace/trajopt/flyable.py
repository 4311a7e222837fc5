"""Whether a trajectory can be flown: its limits, its height, the pylons."""

import math

import numpy as np

from airrace.common.jit import compiled
from airrace.track import BOARD_OFFSET, BOARD_SIZE, PYLON_HEIGHT
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.flatness import inverse_dynamics
from airrace.trajopt.flight_limits import FlightLimits
from airrace.trajopt.reference import as_reference
from airrace.vehicle import GRAVITY

LOWEST = 1.0  # m, the least height
MAX_CROSSING_ANGLE = np.deg2rad(60.0)  # of a gate, off its heading
_BOARD_REACH = np.hypot(BOARD_OFFSET, BOARD_SIZE / 2)  # m, from the axis of their pylon
MARGIN = 0.44  # m, for what the map and the controller leave
_RATE = 100.0  # Hz


def clearance_of(radius: float, margin=MARGIN):
    """Returns how far from a pylon's axis a drone of a radius should keep (m).

    Args: radius: (m). margin: between drone and boards, a number or an array (m).
    """
    return _BOARD_REACH + radius + margin


def is_flyable(
    trajectory: FlatTrajectory,
    pylons,
    *,
    clearance,
    max_speed,
    max_acceleration,
    rotors: FlightLimits | None = None,
) -> bool:
    """Whether a trajectory keeps its limits, its height, and clear of pylons.

    Args:
        trajectory: to check, at 100 Hz.
        pylons: axes to keep clear of, [x, y], (n, 2) m.
        clearance: from those, a number or (n,) m.
        max_speed, max_acceleration: (m/s), (m/s^2).
        rotors: whose rotors must be able to fly it; None does not ask.
    """
    samples = trajectory.sample(sample_times(trajectory))
    speed, acceleration = peaks(samples)
    return bool(
        speed <= max_speed
        and acceleration <= max_acceleration
        and samples[2].min() >= LOWEST
        and np.all(pylon_distances(samples, pylons) >= clearance)
        and (rotors is None or rotor_excess(samples, rotors) <= 0.0)
    )


def rotor_excess(samples, limits: FlightLimits) -> float:
    """Returns by which share of its limit the worst rotor is beyond it, or below zero.

    Args:
        samples: as in trajopt/reference.py, (18, N).
        limits: of the rotors.
    """
    thrusts, _ = inverse_dynamics(samples, limits.vehicle, GRAVITY, limits.drag)
    shares = thrusts / limits.max_thrusts[:, None]
    return float(max(shares.max() - 1.0, limits.idle_share / limits.thrust_share - shares.min()))


def sample_times(trajectory: FlatTrajectory) -> np.ndarray:
    """Returns the times of a dense check, both ends included (s)."""
    return np.linspace(0.0, trajectory.duration, int(_RATE * trajectory.duration) + 2)


def pylon_distances(samples, pylons) -> np.ndarray:
    """Returns the distance of every sample from every pylon's axis, (N, n) m.

    The axes end at the pylons' tips: far above those, a drone is clear.

    Args:
        samples: as in trajopt/reference.py, (18, N).
        pylons: axes, [x, y], (n, 2) m.
    """
    return _pylon_distances(
        np.ascontiguousarray(samples[:3], float),
        np.ascontiguousarray(np.reshape(pylons, (-1, 2)), float),
    )


@compiled
def _pylon_distances(p, pylons):
    """See pylon_distances(), of positions, (3, N) m."""
    distances = np.empty((p.shape[1], len(pylons)))
    for i in range(p.shape[1]):
        above = 0.0 if p[2, i] <= PYLON_HEIGHT else p[2, i] - PYLON_HEIGHT  # NaN stays NaN
        for j in range(len(pylons)):
            x, y = p[0, i] - pylons[j, 0], p[1, i] - pylons[j, 1]
            distances[i, j] = math.sqrt(x * x + y * y + above * above)
    return distances


def passes_forward(trajectory: FlatTrajectory, times, headings) -> np.ndarray:
    """Whether gates are passed forward, within MAX_CROSSING_ANGLE, (n,) bool.

    Args:
        trajectory: that passes them.
        times: when, (n,) s.
        headings: of the gates, (n,) rad.
    """
    velocity = as_reference(trajectory.sample(times)).velocity
    along = velocity[0] * np.cos(headings) + velocity[1] * np.sin(headings)
    return along > np.cos(MAX_CROSSING_ANGLE) * np.linalg.norm(velocity, axis=0)


def peaks(samples) -> tuple[float, float]:
    """Returns the largest speed and acceleration of samples (18, N) (m, s)."""
    return (
        float(np.linalg.norm(as_reference(samples).velocity, axis=0).max()),
        float(np.linalg.norm(as_reference(samples).acceleration, axis=0).max()),
    )
