"""A time-optimal lap as a trajectory in x, y, z and yaw."""

from math import factorial
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
    """How a lap was found and what it asks of the vehicle."""

    #: Lap time of a point mass with the same limits through the same gates, and as far from the
    #: pylons (s).
    bound: float
    check: FlightCheck  #: of the lap as planned
    iterations: int  #: of convex programs
    warm: bool  #: whether it started from another lap


class OptimalCircuit(Circuit):
    """One lap from gate 1 to gate 1.

    Attributes:
        spline: the LapSpline, to start another optimisation from.
        summary: LapSummary.
    """

    def __init__(
        self,
        polynomial: PiecewisePolynomial,
        headings: np.ndarray,
        spline: LapSpline,
        summary: LapSummary,
    ):
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
    lap: LapSpline,
    limits: FlightLimits,
    turn: float,
    refinement: int,
    end: np.ndarray | None = None,
) -> PiecewisePolynomial:
    """Returns a lap as a trajectory of x, y, z (m) and yaw (rad), from time 0.

    The path is the lap's. Yaw, its rate and its acceleration are exact at the
    breaks, and Hermite interpolants in between.

    Args:
        lap: to convert.
        limits: for the vehicle.
        turn: of yaw in a lap (rad); of an open one, see LapSamples.of().
        refinement: pieces of yaw to one of the path.
        end: of an open one, its value and four derivatives of x, y, z and yaw there, (5, 4).
    """
    count = lap.pieces * refinement
    samples = LapSamples.of(lap, Grid(lap.pieces, count), limits, turn)
    order, h = np.arange(DEGREE), samples.units[:, None] / count
    start = np.moveaxis(samples.derivatives.reshape(DEGREE, -1, 4), 0, 1)
    start = start / samples.units[:, None, None] ** order[:, None]
    start[:, :3, 3] = _yaw(samples).T
    after = np.concatenate([start[1:], [start[0] if end is None else end]])
    after[-1, 0, 3] += turn if end is None else 0.0
    # The snap of each piece is linear.
    fifth = (after[:, 4, :3] - start[:, 4, :3]) / h
    path = np.concatenate([start[..., :3], fifth[:, None]], axis=1).swapaxes(1, 2)
    path = path / np.array([factorial(k) for k in range(DEGREE + 1)])
    yaws = [each[:, :3, 3] for each in (start, after)]
    # Full turns between neighbours are none.
    yaws[1][:, 0] += 2 * np.pi * np.round((yaws[0][:, 0] - yaws[1][:, 0]) / (2 * np.pi))
    basis, _ = unit_segment(DEGREE, 1)
    yaw = np.hstack([each * h ** order[:3] for each in yaws]) @ basis.T
    yaw = yaw / h ** np.arange(DEGREE + 1)
    breaks = np.concatenate([[0.0], np.cumsum(h)])
    return piecewise_polynomial(np.concatenate([path, yaw[:, None]], axis=1), breaks)


def _yaw(samples: LapSamples) -> np.ndarray:
    """Returns yaw, its rate and its acceleration at samples, (3, N)."""
    units = samples.units
    _, force, w, alpha = angle_dynamics(samples.flat, units, samples.axes, samples.limits)
    z = force / np.linalg.norm(force, axis=0)
    c, s = (f(samples.derivatives[0, ..., 3].ravel()) for f in (np.cos, np.sin))
    x, y = (c * samples.axes[0] + s * samples.axes[1], c * samples.axes[1] - s * samples.axes[0])
    return yaw_of_attitude((x, y, z), w / units, alpha / units**2)
