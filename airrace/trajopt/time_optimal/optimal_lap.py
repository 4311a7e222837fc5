"""Time-optimal laps, within what the rotors can do."""

import contextlib
import dataclasses as dc

import numpy as np
from pydrake.trajectories import PiecewisePolynomial

from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.feasibility import FlightCheck, check_flight, passes_forward, sample_times
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.flight_limits import FlightConstraints
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.time_optimal.lap_samples import Grid, LapSamples, slowed
from airrace.trajopt.time_optimal.lap_search import IN_FLIGHT, PIECES, Effort, LapSearch
from airrace.trajopt.time_optimal.lap_spline import ORDERS, LapSpline, basis
from airrace.trajopt.time_optimal.lap_step import LapStep
from airrace.trajopt.time_optimal.optimal_circuit import LapSummary, OptimalCircuit, flat_polynomial
from airrace.trajopt.time_optimal.path_terms import angle_cost
from airrace.trajopt.time_optimal.point_mass import PointMassBound, point_mass_bound
from airrace.trajopt.time_optimal.visibility import keep_in_view

_FINE = 120  # samples of each leg in the last check
PRECISION = dict(intervals=16, tolerance=1e-4)  # of the point mass's lap to start from
_POOR = 1.015  # times the bound: a slower lap is improved with finer splines
_FINER_PIECES, _FINER = 8, Effort(iterations=10, tolerance=2e-4, samples=40)
_MOST_HELPFUL = 1.5  # times the bound: a slower lap is none to start from
# Of time, for an excess of thrust: that goes with its square.
_SLOWING, _LEAST_SLOWING, _MOST_SLOWINGS = 0.6, 2e-5, 8
_REFINEMENTS, _NEGLIGIBLE = (4, 8, 16), 2e-3

# Of the error in velocity, in durations of a leg; and of a change of gates.
_SMOOTHNESS, _MOVE_SMOOTHNESS = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3), 1e-3
_FIT_SAMPLES, _FIT_WEIGHTS = 48, (1.0, 0.1, 0.01)  # of a leg; of value, velocity, acceleration
_VIEW_COST = 1e3  # against radians per second squared


def plan_optimal_circuit(
    gates: GateRegions,
    constraints: FlightConstraints,
    *,
    previous: OptimalCircuit | None = None,
    bound: PointMassBound | None = None,
    effort: Effort | None = None,
) -> OptimalCircuit:
    """Returns the quickest lap through the gates that the vehicle can fly.

    The search of lap_search.py starts from a previous lap or from that of a point mass; the lap
    found is slowed until it keeps its limits at 1 kHz.

    Args:
        gates: to pass.
        constraints: to keep.
        previous: a lap through similar gates, to start from.
        bound: a point mass's lap through these gates, if it is known. A lap that does not
            start from another one starts from its own.
        effort: when to stop; by default soon if started from another lap.

    Raises:
        TrajectoryOptimizationError: if there is no such lap.
    """
    constraints.check()

    now = None
    if previous is not None and len(previous.headings) == len(gates.headings):
        samples, pieces = (effort or IN_FLIGHT).samples, previous.spline.pieces
        search = LapSearch(gates, gates.turn, constraints, Grid(pieces, samples))
        with contextlib.suppress(TrajectoryOptimizationError):
            now = _moved_lap(previous.spline, search)
    if bound is None or now is None:
        bound = point_mass_bound(gates, constraints, **({} if now else PRECISION))  # type: ignore[arg-type]
    if now is not None and now.lap.duration >= _MOST_HELPFUL * bound.duration:
        now = None
    warm = now is not None
    effort = effort or (IN_FLIGHT if warm else Effort())
    if now is None:
        search = LapSearch(gates, gates.turn, constraints, Grid(PIECES, effort.samples))
        now = first_lap(bound, search)
    now, iterations = search.improve(now, warm, effort)
    fine = search.settled(now.lap, _FINE)
    if not warm and fine.lap.duration > _POOR * bound.duration:
        # Stuck where a rotor idles, or for want of control points or of samples.
        search = LapSearch(gates, gates.turn, constraints, Grid(_FINER_PIECES, _FINER.samples))
        finer = search.settled(refined_lap(now.lap, _FINER_PIECES))
        now, more = search.improve(finer, True, _FINER)
        iterations += more
        fine = search.settled(now.lap, _FINE)
    search.require_clear(now)
    lap, polynomial, check = _finish(fine.lap, search)
    summary = LapSummary(bound=bound.duration, check=check, iterations=iterations, warm=warm)
    return OptimalCircuit(polynomial, gates.headings, lap, summary)


def first_lap(bound: PointMassBound, search: LapSearch) -> LapSamples:
    """Returns a lap that crosses gates where and when a point mass does.

    Of several, smoother and nearer to it, this is the one that is the quickest when
    slowed until the limits are kept; its thrust-axis angle is the smoothest in view. It raises
    TrajectoryOptimizationError if it cannot be flown, however slow.
    """
    gates, grid, limits = search.gates, search.grid, search.constraints.limits
    # What turns too fast for the limit will have to take another path.
    nimble = dc.replace(limits, max_rate=1e3, max_axis_rates=(np.inf,) * 3)
    laps = []
    for smoothness in _SMOOTHNESS:
        path = bound.positions, bound.velocities, bound.durations
        lap = LapSpline.through(*path, grid.pieces, smoothness)
        laps.append(slowed(lap, grid, nimble, search.turn, 1e-2))
    samples = min(laps, key=lambda samples: samples.lap.duration)
    step = LapStep(samples, grid)
    step.only_angle()
    angle_cost(step, 1.0)
    keep_in_view(step, gates, search.view, _VIEW_COST)
    return search.settled(step.solve() or samples.lap)


def _moved_lap(lap: LapSpline, search: LapSearch) -> LapSamples:
    """Returns a lap through as many gates moved smoothly to those of a search, or raises."""
    place = lap.gates[:, 0, :3]
    rest = np.zeros((len(place), search.grid.samples, 3))
    step = search.gates.nearest(place) - place
    change = LapSpline.through(step, rest, lap.durations, lap.pieces, _MOVE_SMOOTHNESS)
    lap = dc.replace(lap, gates=lap.gates + change.gates, interior=lap.interior + change.interior)
    return search.settled(lap)


def refined_lap(lap: LapSpline, pieces: int) -> LapSpline:
    """Returns nearly the same lap with splines of more pieces."""
    if pieces == lap.pieces:
        return lap
    fractions = np.linspace(0.0, 1.0, _FIT_SAMPLES)
    new = dc.replace(lap, interior=np.zeros((len(lap.durations), pieces - ORDERS, 4)))
    wanted = lap.evaluate(basis(lap.pieces, tuple(fractions))[: len(_FIT_WEIGHTS)])
    return new.fitted(wanted, fractions, _FIT_WEIGHTS)


def _finish(
    lap: LapSpline, search: LapSearch
) -> tuple[LapSpline, PiecewisePolynomial, FlightCheck]:
    """Returns the lap slowed until it keeps its limits at 1 kHz, as polynomial, and its check."""
    gates, constraints = search.gates, search.constraints
    lap = lap.dilated(1.0 + _LEAST_SLOWING)

    def checked(refinement):
        polynomial = flat_polynomial(lap, constraints.limits, gates.turn, refinement)
        trajectory = FlatTrajectory(polynomial)
        samples = trajectory.sample(sample_times(trajectory, 1000.0))
        return polynomial, check_flight(samples, constraints.pylons, constraints.limits)

    # Yaw is no spline, but nearly one; at a steep tilt it takes many pieces.
    for refinement in _REFINEMENTS:
        polynomial, check = checked(refinement)
        if check.excess < _NEGLIGIBLE:
            break
    for _ in range(_MOST_SLOWINGS):
        if check.excess <= 0.0:
            break
        lap = lap.dilated(1.0 + _SLOWING * check.excess + _LEAST_SLOWING)
        polynomial, check = checked(refinement)
    else:
        raise TrajectoryOptimizationError("The lap found does not keep its limits everywhere.")
    gate_times = np.cumsum([0.0, *lap.durations])[:-1]
    if not passes_forward(FlatTrajectory(polynomial), gate_times, gates.headings).all():
        raise TrajectoryOptimizationError("The lap found crosses a gate sideways.")
    return lap, polynomial, check
