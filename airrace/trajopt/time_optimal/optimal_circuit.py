"""A time-optimal lap as a trajectory in x, y, z and yaw."""

from typing import NamedTuple

import numpy as np
from pydrake.trajectories import PiecewisePolynomial

from airrace.trajopt.feasibility import FlightCheck
from airrace.trajopt.flat_trajectory import piecewise_polynomial
from airrace.trajopt.flight_limits import FlightLimits
from airrace.trajopt.hermite import unit_segment
from airrace.trajopt.min_snap.circuit import Circuit
from airrace.trajopt.time_optimal.lap_samples import Grid, LapSamples, angle_dynamics
from airrace.trajopt.time_optimal.lap_spline import DEGREE, LapSpline
from airrace.trajopt.time_optimal.thrust_axis_angle import yaw_of_attitude


class LapSummary(NamedTuple):
    """How a lap was found and what it asks of the vehicle.

    Attributes:
        bound: lap time of a point mass with the same limits through the same gates, and as far
            from the pylons (s).
        check: of the lap as planned.
        iterations: of convex programs.
        warm: whether it started from another lap.
    """

    bound: float
    check: FlightCheck
    iterations: int
    warm: bool


class OptimalCircuit(Circuit):
    """One lap from gate 1 to gate 1.

    Attributes:
        spline: the LapSpline, to start another optimisation from.
        summary: LapSummary.
    """

    def __init__(self, polynomial, headings, spline: LapSpline, summary: LapSummary):
        """Args: polynomial: of flat_polynomial(). The others: see Circuit and above."""
        breaks = polynomial.get_segment_times()
        gate_times = breaks[:: (len(breaks) - 1) // len(headings)]
        super().__init__(polynomial, gate_times, headings, approach={})
        self.spline = spline
        self.summary = summary

    @property
    def waypoint_times(self) -> tuple:
        """When gates are passed, then the duration (s)."""
        return self.gate_times


def flat_polynomial(
    lap: LapSpline, limits: FlightLimits, turn: float, refinement: int, end=None
) -> PiecewisePolynomial:
    """Returns a lap as a trajectory of x, y, z (m) and yaw (rad), from time 0.

    The path is the lap's. Yaw, its rate and its acceleration are exact at the
    breaks, and Hermite interpolants in between.

    Args:
        lap: to convert.
        limits: for the vehicle.
        turn: of yaw in a lap (rad); of an open one, see LapSamples.of().
        refinement: pieces of yaw to one of the path.
        end: of an open one, its value and two derivatives of x, y, z and yaw there, (3, 4).
    """
    count = lap.pieces * refinement
    samples = LapSamples.of(lap, Grid(lap.pieces, count), limits, turn)
    order = np.arange(3)[:, None]
    units = samples.units[:, None, None]
    path = np.moveaxis(samples.derivatives[:3, ..., :3].reshape(3, -1, 3), 0, 1) / units**order
    start = np.concatenate([path, _yaw(samples).T[..., None]], axis=2)  # (N, 3, 4)
    if end is None:
        end = start[0] + [[0.0, 0.0, 0.0, turn], [0.0] * 4, [0.0] * 4]
    after = np.concatenate([start[1:], end[None]])
    # Full turns between neighbours are none.
    after[:, 0, 3] += 2 * np.pi * np.round((start[:, 0, 3] - after[:, 0, 3]) / (2 * np.pi))
    h = units / count
    basis, _ = unit_segment(DEGREE, 1)
    coefficients = basis @ np.concatenate([start * h**order, after * h**order], axis=1)
    coefficients /= h ** np.arange(DEGREE + 1)[:, None]
    return piecewise_polynomial(coefficients.swapaxes(1, 2), h.ravel())


def _yaw(samples: LapSamples) -> np.ndarray:
    """Returns yaw, its rate and its acceleration at samples, (3, N)."""
    units = samples.units
    _, force, w, alpha = angle_dynamics(samples.flat, units, samples.axes, samples.limits)
    z = force / np.linalg.norm(force, axis=0)
    c, s = (f(samples.derivatives[0, ..., 3].ravel()) for f in (np.cos, np.sin))
    x, y = (c * samples.axes[0] + s * samples.axes[1], c * samples.axes[1] - s * samples.axes[0])
    return yaw_of_attitude((x, y, z), w / units, alpha / units**2)
