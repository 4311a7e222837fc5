"""Whether a trajectory is feasible: limits of the vehicle, height, pylons, gates."""

import dataclasses as dc

import numpy as np
from numpy.typing import ArrayLike

from airrace.common.immutable import Immutable
from airrace.track import BOARD_OFFSET, BOARD_SIZE, PYLON_HEIGHT
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.flatness import inverse_dynamics
from airrace.trajopt.flight_limits import FlightConstraints, FlightLimits
from airrace.trajopt.reference import as_reference

# s, of a lap or of a transition: what takes longer is where a search lost its way.
MAX_DURATION = 600.0
MAX_CROSSING_ANGLE = np.deg2rad(60.0)  # of a gate, off its heading
MARGIN = 0.44  # m, for what the map and the controller leave
_BOARD_REACH = np.hypot(BOARD_OFFSET, BOARD_SIZE / 2)  # m, from the axis of their pylon
_ACTIVE = 0.98  # of a limit: laps leave a little for the transitions onto them


def clearance_of(radius: float, margin: float | np.ndarray = MARGIN) -> float | np.ndarray:
    """Returns how far from a pylon's axis a drone of a radius should keep (m).

    Args: radius: (m). margin: between drone and boards, a number or an array (m).
    """
    return _BOARD_REACH + radius + margin


def is_feasible(trajectory: FlatTrajectory, constraints: FlightConstraints) -> bool:
    """Whether a trajectory keeps its constraints and its height, checked at 100 Hz."""
    limits, samples = constraints.limits, trajectory.sample(sample_times(trajectory))
    speed, acceleration = peaks(samples)
    return bool(
        speed <= limits.max_speed
        and acceleration <= limits.max_acceleration
        and samples[2].min() >= constraints.min_height
        and np.all(pylon_distances(samples, constraints.pylons) >= constraints.clearance)
        and check_flight(samples, (), limits).excess <= 0.0
    )


def sample_times(trajectory: FlatTrajectory, rate: float = 100.0) -> np.ndarray:
    """Returns the times of a check at a rate (Hz), both ends included (s).

    Raises:
        TrajectoryOptimizationError: if the trajectory takes longer than MAX_DURATION.
    """
    duration = trajectory.duration
    if not duration <= MAX_DURATION:
        raise TrajectoryOptimizationError(
            f"A flight of {duration:.3g} s was found, longer than {MAX_DURATION:.0f} s."
        )
    return np.linspace(0.0, duration, int(np.ceil(rate * duration)) + 1)


def pylon_distances(samples: np.ndarray, pylons: ArrayLike) -> np.ndarray:
    """Returns the distance of every sample from every pylon's axis, (N, n) m.

    The axes [x, y], (n, 2) m, end at the pylons' tips: far above those, a drone is clear.
    Samples are References as vectors, (18, N), or positions alone, (3, N) m.
    """
    samples = np.asarray(samples, float)
    x, y = samples[:2, :, None] - np.reshape(np.asarray(pylons, float), (-1, 2)).T[:, None]
    above = np.maximum(samples[2] - PYLON_HEIGHT, 0.0)[:, None]
    return np.sqrt(x * x + y * y + above * above)


def passes_forward(
    trajectory: FlatTrajectory,
    times: ArrayLike,
    headings: ArrayLike,
    within: float = MAX_CROSSING_ANGLE,
) -> np.ndarray:
    """Whether gates are passed forward, within an angle of their headings, (n,) bool.

    Args:
        times: when they are passed, (n,) s.
        headings: of the gates, (n,) rad.
        within: the angle (rad).
    """
    velocity = as_reference(trajectory.sample(times)).velocity
    along = velocity[0] * np.cos(headings) + velocity[1] * np.sin(headings)
    return along > np.cos(within) * np.linalg.norm(velocity, axis=0)


def peaks(samples: np.ndarray) -> tuple[float, float]:
    """Returns the largest speed and acceleration of samples (18, N) (m, s)."""
    r = as_reference(samples)
    return tuple(float(np.linalg.norm(v, axis=0).max()) for v in (r.velocity, r.acceleration))  # type: ignore[return-value]


@dc.dataclass(frozen=True, eq=False)
class FlightCheck(Immutable):
    """The extremes of a flight, by inverse dynamics."""

    max_speed: float  #: m/s
    max_acceleration: float  #: without gravity (m/s^2)
    max_rate: float  #: of the body's angular velocity (rad/s)
    #: max_thrusts, min_thrusts: of every rotor (N), tuples
    max_thrusts: tuple
    min_thrusts: tuple
    clearance: float  #: from the nearest pylon's axis (m)
    #: The largest of all limited quantities over its limit, less one; at most zero if the limits
    #: are kept.
    excess: float
    active_limits: tuple  #: names of the limits that are used to the full


def check_flight(samples: np.ndarray, pylons: ArrayLike, limits: FlightLimits) -> FlightCheck:
    """Checks samples of a flight.

    Args: samples: References as vectors, (18, N). pylons: axes, [x, y], (m, 2) m. limits: to keep.
    """
    thrusts, w = inverse_dynamics(samples, limits.vehicle, limits.air)
    most = limits.max_thrusts[:, None]
    speed, acceleration = peaks(samples)
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
        clearance=float(pylon_distances(samples, pylons).min(initial=np.inf)),
        excess=max(shares.values()) - 1.0,
        active_limits=tuple(name for name, share in shares.items() if share > _ACTIVE),
    )
