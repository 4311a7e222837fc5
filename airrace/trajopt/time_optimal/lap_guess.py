"""Laps to start an optimisation from."""

import dataclasses as dc

import numpy as np

from airrace.trajopt.flight_limits import FlightLimits
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.time_optimal.lap_samples import Grid, LapSamples, slowed
from airrace.trajopt.time_optimal.lap_spline import ORDERS, LapSpline, basis
from airrace.trajopt.time_optimal.lap_step import LapStep
from airrace.trajopt.time_optimal.path_terms import angle_cost
from airrace.trajopt.time_optimal.point_mass import PointMassBound
from airrace.trajopt.time_optimal.visibility import keep_in_view

# Of the error in velocity, in durations of a leg; and of a change of gates.
_SMOOTHNESS, _MOVE_SMOOTHNESS = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3), 1e-3
_FIT_SAMPLES, _FIT_WEIGHTS = 48, (1.0, 0.1, 0.01)  # of a leg; of value, velocity, acceleration
_VIEW_COST = 1e3  # against radians per second squared


def first_lap(
    bound: PointMassBound, gates: GateRegions, grid: Grid, limits: FlightLimits, half_view
) -> LapSamples:
    """Returns a lap that crosses gates where and when a point mass does.

    Of several, smoother and nearer to it, this is the one that is the quickest when
    slowed until the limits are kept; its thrust-axis angle is the smoothest in view.

    Args:
        bound: the point mass.
        gates, grid, limits: see there.
        half_view: see angle_bounds().

    Raises:
        TrajectoryOptimizationError: if it cannot be flown, however slow.
    """
    laps = []
    for smoothness in _SMOOTHNESS:
        path = bound.positions, bound.velocities, bound.durations
        lap = LapSpline.through(*path, grid.pieces, smoothness)
        # What turns too fast for the limit will have to take another path.
        laps.append(slowed(lap, grid, dc.replace(limits, max_rate=1e3), gates.turn, 1e-2))
    samples = min(laps, key=lambda samples: samples.lap.duration)
    step = LapStep(samples, grid)
    step.only_angle()
    angle_cost(step, 1.0)
    keep_in_view(step, gates, half_view, _VIEW_COST)
    return slowed(step.solve() or samples.lap, grid, limits, gates.turn)


def moved_lap(lap: LapSpline, gates: GateRegions, grid: Grid, limits: FlightLimits) -> LapSamples:
    """Returns a lap moved smoothly such that it crosses other gates.

    Args: lap: through as many gates. The others: see first_lap().

    Raises:
        TrajectoryOptimizationError: if it cannot be flown, however slow.
    """
    place = lap.gates[:, 0, :3]
    rest = np.zeros((len(place), grid.samples, 3))
    step = gates.nearest(place) - place
    change = LapSpline.through(step, rest, lap.durations, grid.pieces, _MOVE_SMOOTHNESS)
    lap = dc.replace(lap, gates=lap.gates + change.gates, interior=lap.interior + change.interior)
    return slowed(lap, grid, limits, gates.turn)


def refined_lap(lap: LapSpline, pieces: int) -> LapSpline:
    """Returns nearly the same lap with splines of more pieces.

    Args: lap: to refine. pieces: of each leg's spline.
    """
    fractions = np.linspace(0.0, 1.0, _FIT_SAMPLES)
    new = dc.replace(lap, interior=np.zeros((len(lap.durations), pieces - ORDERS, 4)))
    wanted = lap.evaluate(basis(lap.pieces, tuple(fractions))[: len(_FIT_WEIGHTS)])
    return new.fitted(wanted, fractions, _FIT_WEIGHTS)
