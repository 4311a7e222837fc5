"""Time-optimal laps, within what the rotors can do."""

import contextlib
import dataclasses as dc
import time

import numpy as np

from airrace.trajopt.bound import point_mass_bound
from airrace.trajopt.clearance_rows import cross_forward, keep_clear, shortfall
from airrace.trajopt.dynamics_limits import limit_dynamics
from airrace.trajopt.flight_limits import FlightLimits
from airrace.trajopt.flyable import passes_forward
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.lap_costs import smooth_twist, stay_near
from airrace.trajopt.lap_guess import first_lap, moved_lap
from airrace.trajopt.lap_samples import Grid, LapSamples, slowed
from airrace.trajopt.lap_step import LapStep
from airrace.trajopt.min_snap import TrajectoryOptimizationError
from airrace.trajopt.optimal_circuit import OptimalCircuit, flat_polynomial
from airrace.trajopt.plan_report import LapReport, check_lap
from airrace.trajopt.visibility import LEAST_RANGE, keep_in_view, out_of_view

_PIECES, _FINE = 6, 120  # of each leg's spline; samples of the last check
_BOUND_INTERVALS, _QUICK_INTERVALS = 16, 8
_FIRST_WEIGHT, _WARM_WEIGHT = 0.1, 0.02  # of staying near, in the first step
_MOST_WEIGHT = 100.0
_FIRST_REACH, _REACH = 0.5, 0.25  # of a step, see limit_dynamics()
_MOST_HELPFUL = 1.5  # times the bound: a slower lap is none to start from
_TWIST_WEIGHT = 1e-4
# Costs of what a step cannot avoid: s per rad, per m, per m/s. Laps are compared by
# the worst of each, at lower costs: steps aim at none, and miss a little.
_VIEW_COST, _CLEARANCE_COST, _FORWARD_COST = 10.0, 20.0, 1.0
_VIEW_MERIT, _CLEARANCE_MERIT = 3.0, 5.0
_VIEW_MARGIN = np.deg2rad(1.5)  # for what lies between samples
# Of time, for an excess of thrust: that goes with its square.
_SLOWING, _LEAST_SLOWING, _MOST_SLOWINGS = 0.6, 2e-5, 8
_REFINEMENTS, _NEGLIGIBLE = (4, 8, 16), 2e-3
_TOO_NEAR = 0.05  # m, that no lap may lack


@dc.dataclass(frozen=True)
class Effort:
    """When an optimisation ends.

    Attributes:
        iterations: at most, of convex programs.
        tolerance: promise of an iteration, as a share of the lap time, that is too
            little to go on.
        samples: of each leg.
    """

    iterations: int = 15
    tolerance: float = 5e-4
    samples: int = 24

    @classmethod
    def quick(cls) -> "Effort":
        """Returns one for planning in flight, from a lap through gates that moved a little."""
        return cls(iterations=2, tolerance=5e-3, samples=18)


def plan_optimal_circuit(gates: GateRegions, pylons, limits: FlightLimits, *, clearance: float,
                         half_view: float | None = np.deg2rad(40.0),
                         previous: OptimalCircuit | None = None,
                         effort: Effort | None = None) -> OptimalCircuit:
    """Returns the quickest lap through the gates that the vehicle can fly.

    Sequential convex programming. Unknown are the derivatives through snap at the
    gates, control points of quintic splines between them, and the durations of
    the legs; x, y, z and the twist of the body about its thrust (see twist.py)
    together. Each program is convex about the last lap (see lap_step.py); then
    the lap is flown slower as a whole, as little as all limits ask for, so that
    every iteration ends with one that can be flown.

    Args:
        gates: to pass.
        pylons: axes to keep clear of, [x, y], (m, 2) m.
        limits: of the vehicle, and those added.
        clearance: from the pylons' axes (m).
        half_view: angle (rad) off the heading within which the midpoint of the
            next gate stays, until it is LEAST_RANGE near; None for any.
        previous: a lap through similar gates, to start from.
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
    problem = _Problem(gates, pylons, limits, clearance, half_view)
    now = None
    if previous is not None and len(previous.headings) == len(gates.headings):
        problem.grid = Grid(_PIECES, (effort or Effort.quick()).samples)
        with contextlib.suppress(TrajectoryOptimizationError):
            now = moved_lap(previous.spline, gates, problem.grid, limits)
    bound = _bound(gates, limits, _BOUND_INTERVALS if now is None else _QUICK_INTERVALS)
    warm = now is not None and now.lap.duration < _MOST_HELPFUL * bound.duration
    effort = effort or (Effort.quick() if warm else Effort())
    if not warm:
        problem.grid = Grid(_PIECES, effort.samples)
        now = first_lap(bound, gates, problem.grid, limits, problem.view)
    now, iterations = problem.improve(now, warm, effort)
    problem.require_clear(now)
    return _finish(now, problem, lambda circuit, check: LapReport(
        duration=circuit.duration, bound=bound.duration, check=check, solver="Clarabel",
        iterations=iterations, solve_time=time.perf_counter() - clock, warm=warm))


def _bound(gates, limits: FlightLimits, intervals):
    limited = {name: getattr(limits, name) for name in ("max_speed", "max_acceleration")
               if np.isfinite(getattr(limits, name))}
    return point_mass_bound(gates, max_specific_force=limits.max_specific_force,
                            intervals=intervals, **limited)


class _Problem:
    """All that a lap has to keep."""

    def __init__(self, gates, pylons, limits, clearance, half_view):
        self.gates, self.pylons, self.limits, self.grid = gates, pylons, limits, None
        self.clearance, self.view = clearance, None
        if half_view is not None:
            self.view = max(half_view - _VIEW_MARGIN, half_view / 2)

    def improve(self, now: LapSamples, near: bool, effort) -> tuple[LapSamples, int]:
        """Returns a better lap, after how many steps; near is to start near the best."""
        weight, reach = (_WARM_WEIGHT, _REACH) if near else (_FIRST_WEIGHT, _FIRST_REACH)
        merit, least, iteration = self._merit(now), 0.0, 0
        for iteration in range(1, effort.iterations + 1):
            step = self._step(now, weight, reach)
            new = step.solve()
            if new is None:
                weight *= 10.0
            else:
                try:
                    after = slowed(new, self.grid, self.limits, self.gates.turn)
                    after_merit = self._merit(after)
                except TrajectoryOptimizationError:
                    after_merit = np.inf
                gain = merit - after_merit
                # How much of what was promised came true.
                ratio = gain / max(merit - new.duration, 1e-9)
                small = merit - new.duration < effort.tolerance * merit
                if gain > 0.0:
                    now, merit, reach = after, after_merit, _REACH
                if small:
                    break
                if ratio < 0.3:
                    weight, least = 4.0 * weight, 2.0 * weight
                elif ratio > 0.7:
                    weight = max(0.2 * weight, least)
                    least *= 0.5
            if weight > _MOST_WEIGHT:
                break
        return now, iteration

    def _step(self, now, weight, reach):
        step = LapStep(now, self.grid)
        for i, place in enumerate(now.lap.gates[:, 0, :3]):
            self.gates.constrain(step.program, i, step.at_gate(i, 0)[0], place)
        limit_dynamics(step, reach)
        keep_clear(step, self.pylons, self.clearance, _CLEARANCE_COST)
        cross_forward(step, self.gates, _FORWARD_COST)
        if self.view is not None:
            keep_in_view(step, self.gates, self.view, _VIEW_COST)
        stay_near(step, weight)
        smooth_twist(step, _TWIST_WEIGHT)
        return step

    def _merit(self, samples):
        lack = shortfall(samples.lap, self.pylons, self.clearance)
        merit = samples.lap.duration + _CLEARANCE_MERIT * lack
        if self.view is not None:
            merit += _VIEW_MERIT * out_of_view(samples, self.gates, self.view)
        return merit

    def require_clear(self, samples):
        """Raises TrajectoryOptimizationError if the lap comes too near to anything."""
        lack = shortfall(samples.lap, self.pylons, self.clearance)
        if lack > _TOO_NEAR:
            raise TrajectoryOptimizationError(
                f"No lap found keeps {self.clearance:.2f} m clear of all pylons and of the "
                f"ground; the best lacks {lack:.2f} m.")


def _finish(now: LapSamples, problem: _Problem, make_report) -> OptimalCircuit:
    """Returns the lap as a trajectory that keeps its limits at 1 kHz."""
    gates, limits = problem.gates, problem.limits
    lap = slowed(now.lap, Grid(_PIECES, _FINE), limits, gates.turn).lap
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
