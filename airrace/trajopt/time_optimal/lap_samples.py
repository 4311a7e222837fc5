"""Samples of a lap: what it asks of the vehicle, and how slow it has to be."""

import dataclasses as dc
import functools

import numpy as np

from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.flat_trajectory import pack
from airrace.trajopt.flight_limits import FlightLimits
from airrace.trajopt.reference import as_reference
from airrace.trajopt.time_optimal.dynamics import angle_dynamics
from airrace.trajopt.time_optimal.lap_spline import LapSpline, basis
from airrace.trajopt.time_optimal.thrust_axis_angle import quadrature, transported_axes
from airrace.vehicle import GRAVITY

_LIFT_SHARE = 0.8  # of the least lift: a step aims at all of it, and may miss a little
_FIRST_STEP = 1e-4, 0.5  # least and most, of the factor
_MOST = 50.0  # how many times slower a lap may have to be than the guess


@dc.dataclass(frozen=True)
class Grid:
    """Where legs are sampled."""

    pieces: int  #: of the splines
    samples: int  #: evenly spaced, of each leg; the first is at its gate
    #: Whether the last one is at the next gate, which is a sample of the next leg, too, if there is
    #: a next leg.
    to_end: bool = False

    @functools.cached_property
    def fractions(self) -> np.ndarray:
        """Of a leg, (samples,)."""
        return np.arange(self.samples) / (self.samples - self.to_end)

    @functools.cached_property
    def matrices(self) -> np.ndarray:
        """See lap_spline.basis()."""
        return basis(self.pieces, tuple(self.fractions))

    @functools.cached_property
    def matrices_between(self) -> np.ndarray:
        """Likewise, at the nodes of quadrature()."""
        return basis(self.pieces, tuple(quadrature(self.fractions)))


@dc.dataclass(frozen=True, eq=False)
class LapSamples:
    """A lap's derivatives in normalised time, the last dimension being the thrust-axis angle."""

    lap: LapSpline  #: whose angle closes: a lap turns the body as often as the track does
    limits: FlightLimits  #: that it is to keep
    derivatives: np.ndarray  #: 5, n, samples, 4
    units: np.ndarray  #: duration of every sample's leg, (n samples,) s
    #: X and y, in the world, of a body that does not turn about its thrust, (2, 3, n samples).
    axes: tuple

    @classmethod
    def of(cls, lap: LapSpline, grid: Grid, limits: FlightLimits, turn: float) -> "LapSamples":
        """Samples a lap.

        Args: turn: of yaw in a lap (rad); of an open one, by how much more the body is turned
            against the least rotation to its attitude at the end than at the start, if that is
            given.
        """
        between = lap.evaluate(grid.matrices_between)
        y = lap.evaluate(grid.matrices)
        *axes, total = transported_axes(
            y, between, lap.durations, grid.fractions, lap.chart, limits.air
        )
        if lap.has_turn:
            lap = lap.with_turn(turn + total)
            y = lap.evaluate(grid.matrices)
        return cls(lap, limits, y, np.repeat(lap.durations, grid.samples), tuple(axes))

    @property
    def flat(self) -> np.ndarray:
        """Samples as in trajopt/reference.py, with the thrust-axis angle for yaw, (18, N)."""
        return pack(self.derivatives.reshape(5, -1, 4))

    def excess(self) -> float:
        """Returns the largest of all quantities over their limits, less one; NaN if one is none."""
        return float(np.max(list(self.excesses().values())))

    def excesses(self) -> dict[str, float]:
        """Returns each quantity over its limit, less one, by the name of the limit."""
        limits, flat, units = self.limits, self.flat, self.units
        thrusts, force, w, _ = angle_dynamics(flat, units, self.axes, limits)
        _, velocity, acceleration, *_ = as_reference(flat)
        shares = thrusts / units**2 / limits.max_thrusts[:, None]
        lift = np.min(force[2] / units**2)
        speed, rate = (np.max(np.linalg.norm(v, axis=0) / units) for v in (velocity, w))
        most = np.reshape(limits.max_axis_rates, (3, 1))
        found = {
            "max_speed": speed / limits.max_speed,
            "max_acceleration": np.max(np.linalg.norm(acceleration, axis=0) / units**2)
            / limits.max_acceleration,
            "max_rate": rate / limits.max_rate,
            "max_axis_rates": np.max(np.abs(w) / units / most),
            "thrust_share": shares.max(),
            "idle_share": 1.0 + limits.idle_share / limits.thrust_share - shares.min(),
            "min_lift": 1.0 + (_LIFT_SHARE * limits.min_lift - lift) / GRAVITY,
        }
        return {name: float(share) - 1.0 for name, share in found.items()}


def slowed(
    lap: LapSpline, grid: Grid, limits: FlightLimits, turn: float, tolerance: float = 2e-5
) -> LapSamples:
    """Returns the lap with the least multiple of its durations that keeps the limits.

    Args: see LapSamples.of(). tolerance: of the factor.

    Raises:
        TrajectoryOptimizationError: if no factor does.
    """
    slow = fast = None  # what keeps the limits, and what does not: factor, excess, samples
    factor, step, rounds = 1.0, None, 0
    while slow is None or fast is None or rounds <= 60:
        samples = LapSamples.of(lap.dilated(factor), grid, limits, turn)
        excess = samples.excess()
        if excess <= 0.0:
            slow = factor, excess, samples
        else:
            excess = excess if np.isfinite(excess) else np.inf
            fast = factor, excess, samples
        if slow is None or fast is None:
            if step is None:
                # Most excesses go with the square of the factor: a little beyond its root.
                step = np.clip(0.6 * abs(excess), *_FIRST_STEP)
            factor = factor * (1.0 + step) if slow is None else factor / (1.0 + step)
            step = min(2.0 * step, 0.5)
            if not 1.0 / _MOST < factor < _MOST:
                raise TrajectoryOptimizationError("No lap is within the limits, however slow.")
            continue
        width = slow[0] - fast[0]
        if width <= tolerance * slow[0]:
            break
        # The excess is almost linear; halving is for where it is not.
        share = 0.5
        if rounds % 3 < 2 and np.isfinite(fast[1]):
            share = np.clip(slow[1] / (slow[1] - fast[1]), 0.02, 0.98)
        factor, rounds = slow[0] - share * width, rounds + 1
    return slow[2]
