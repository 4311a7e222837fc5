"""Time-optimal laps, within what the rotors can do."""

import contextlib
import time

import numpy as np

from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.flight_limits import FlightLimits
from airrace.trajopt.flyable import passes_forward
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.plan_summary import LapReport, check_lap
from airrace.trajopt.time_optimal.lap_guess import first_lap, moved_lap, refined_lap
from airrace.trajopt.time_optimal.lap_search import PIECES, Effort, LapSearch
from airrace.trajopt.time_optimal.lap_spline import LapSpline
from airrace.trajopt.time_optimal.optimal_circuit import OptimalCircuit, flat_polynomial
from airrace.trajopt.time_optimal.point_mass import PointMassBound, point_mass_bound
from airrace.trajopt.time_optimal.visibility import LEAST_RANGE

_FINE = 120  # samples of each leg in the last check
_BOUND, _QUICK_INTERVALS = (16, 1e-4), 8
_POOR = 1.015  # times the bound: a slower lap is sought again with finer splines
_FINER_PIECES, _FINER = 8, Effort(iterations=10, tolerance=2e-4, samples=40)
_MOST_HELPFUL = 1.5  # times the bound: a slower lap is none to start from
# Of time, for an excess of thrust: that goes with its square.
_SLOWING, _LEAST_SLOWING, _MOST_SLOWINGS = 0.6, 2e-5, 8
_REFINEMENTS, _NEGLIGIBLE = (4, 8, 16), 2e-3


def plan_optimal_circuit(
    gates: GateRegions,
    pylons,
    limits: FlightLimits,
    *,
    clearance: float,
    half_view: float | None = np.deg2rad(40.0),
    previous: OptimalCircuit | None = None,
    bound: PointMassBound | None = None,
    effort: Effort | None = None,
) -> OptimalCircuit:
    """Returns the quickest lap through the gates that the vehicle can fly.

    Sequential convex programming. Unknown are the derivatives through snap at the
    gates, control points of quintic splines between them, and the durations of
    the legs; x, y, z and the twist of the body about its thrust (see thrust_axis_angle.py)
    together. Each program is convex about the last lap (see lap_step.py); then
    the lap is flown slower as a whole, as little as all limits ask for, so that
    every iteration ends with one that can be flown.

    Args:
        gates: to pass.
        pylons: axes to keep clear of, [x, y], (m, 2) m.
        limits: of the vehicle, and those added.
        clearance: from the pylons' axes, a number or (m,) m.
        half_view: angle (rad) off the heading within which the midpoint of the
            next gate stays, until it is LEAST_RANGE near; None for any.
        previous: a lap through similar gates, to start from.
        bound: a point mass's lap through these gates, if it is known. A lap that does not
            start from another one starts from its own.
        effort: when to stop; by default soon if started from another lap.

    Raises:
        TrajectoryOptimizationError: if there is no such lap.
    """
    clock = time.perf_counter()
    limits.check()
    pylons = np.reshape(np.asarray(pylons, float), (-1, 2))
    if not np.isfinite(pylons).all():
        raise TrajectoryOptimizationError("The place of a pylon is not finite.")
    if half_view is not None and not 0.0 < half_view <= np.pi:
        raise TrajectoryOptimizationError("half_view must be positive, and 180 degrees at most.")

    def search(samples, pieces=PIECES):
        return LapSearch(gates, gates.turn, pylons, limits, clearance, half_view, samples, pieces)

    now = None
    if previous is not None and len(previous.headings) == len(gates.headings):
        problem = search((effort or Effort.quick()).samples, previous.spline.pieces)
        with contextlib.suppress(TrajectoryOptimizationError):
            now = moved_lap(previous.spline, gates, problem.grid, limits)
    if bound is None or now is None:
        precision = _BOUND if now is None else ()
        bound = quickest_point_mass(gates, limits, pylons, clearance, *precision)
    warm = now is not None and now.lap.duration < _MOST_HELPFUL * bound.duration
    effort = effort or (Effort.quick() if warm else Effort())
    if not warm:
        problem = search(effort.samples)
        now = first_lap(bound, gates, problem.grid, limits, problem.view)
    now, iterations = problem.improve(now, warm, effort)
    fine = problem.slowed(now, _FINE)
    if not warm and fine.lap.duration > _POOR * bound.duration:
        # Stuck where a rotor idles, or for want of control points or of samples.
        problem = search(_FINER.samples, _FINER_PIECES)
        finer = problem.settled(refined_lap(now.lap, _FINER_PIECES))
        now, more = problem.improve(finer, True, _FINER)
        iterations += more
        fine = problem.slowed(now, _FINE)
    problem.require_clear(now)
    return _finish(
        fine.lap,
        problem,
        lambda circuit, check: LapReport(
            duration=circuit.duration,
            bound=bound.duration,
            check=check,
            solver="Clarabel",
            iterations=iterations,
            solve_time=time.perf_counter() - clock,
            warm=warm,
        ),
    )


def quickest_point_mass(
    gates: GateRegions,
    limits: FlightLimits,
    pylons,
    clearance,
    intervals: int = _QUICK_INTERVALS,
    tolerance: float = 1e-3,
) -> PointMassBound:
    """Returns the quickest lap of a point mass within the limits of a flight.

    Args: gates, limits: see there. the others: see point_mass_bound().
    """
    limited = {
        name: getattr(limits, name)
        for name in ("max_speed", "max_acceleration")
        if np.isfinite(getattr(limits, name))
    }
    return point_mass_bound(
        gates,
        max_specific_force=limits.max_specific_force,
        pylons=pylons,
        clearance=clearance,
        intervals=intervals,
        tolerance=tolerance,
        **limited,
    )


def _finish(lap: LapSpline, problem: LapSearch, make_report) -> OptimalCircuit:
    """Returns the lap as a trajectory that keeps its limits at 1 kHz."""
    gates, limits = problem.gates, problem.limits
    lap = lap.dilated(1.0 + _LEAST_SLOWING)

    def check(refinement):
        polynomial = flat_polynomial(lap, limits, gates.turn, refinement)
        circuit = OptimalCircuit(polynomial, gates.headings, lap, None)
        return circuit, check_lap(circuit, gates, problem.pylons, limits, LEAST_RANGE)

    # Yaw is no spline, but nearly one; at a steep tilt it takes many pieces.
    for refinement in _REFINEMENTS:
        circuit, found = check(refinement)
        if found.excess < _NEGLIGIBLE:
            break
    for _ in range(_MOST_SLOWINGS):
        if found.excess <= 0.0:
            break
        lap = lap.dilated(1.0 + _SLOWING * found.excess + _LEAST_SLOWING)
        circuit, found = check(refinement)
    else:
        raise TrajectoryOptimizationError("The lap found does not keep its limits everywhere.")
    if not passes_forward(circuit, circuit.gate_times[:-1], gates.headings).all():
        raise TrajectoryOptimizationError("The lap found crosses a gate sideways.")
    circuit.report = make_report(circuit, found)
    return circuit
