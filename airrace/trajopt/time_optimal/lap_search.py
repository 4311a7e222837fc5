"""The search for the quickest lap, or transition: one convex program after another.

**Variables** are the derivatives through snap of x, y, z and of the thrust-axis angle at the
gates, control points of quintic splines between them, and the duration of each leg, see
lap_spline.py. **The cost** is the lap time. **Constraints**, at samples of each leg:

- speed, acceleration, angular velocity and rotor thrusts, by inverse dynamics in normalised
  time: dynamics_limits.py;
- gates are crossed in their windows, and forward: gate_regions.py, path_terms.py;
- clearance from pylons and the ground: path_terms.py;
- the next gate is in the camera's view: visibility.py.

Each iteration linearises what is not convex about the last lap and solves a second-order cone
program (lap_step.py). The change of the lap is penalised (proximal_cost()), which takes the
place of a trust region: the weight rises if the lap time falls by less than predicted, as in
Nocedal and Wright, "Numerical optimization", chapter 4. Then the lap is flown slower as a whole
until all limits are kept, so that every iteration ends with a feasible lap. An open one, whose
ends are in motion, cannot be slowed: it may exceed limits while the search goes on, at a cost.
Sequential convex programming of quadrotor flights: Szmuk, Pascucci, Acikmese, "Real-time
quad-rotor path planning for mobile obstacle avoidance using convex optimization" (IROS 2018).
"""

import dataclasses as dc

import numpy as np

from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.flight_limits import FlightConstraints
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.time_optimal.dynamics_limits import limit_dynamics
from airrace.trajopt.time_optimal.lap_samples import Grid, LapSamples, slowed
from airrace.trajopt.time_optimal.lap_spline import LapSpline
from airrace.trajopt.time_optimal.lap_step import LapStep
from airrace.trajopt.time_optimal.path_terms import (
    angle_cost,
    cross_forward,
    keep_clear,
    proximal_cost,
    shortfall,
    sideways,
    stretch_cost,
)
from airrace.trajopt.time_optimal.visibility import keep_in_view, out_of_view

PIECES = 6  # of each leg's spline, as a rule
_FIRST_WEIGHT, _WARM_WEIGHT = 0.1, 0.02  # of the proximal cost, in the first step
_MAX_WEIGHT = 100.0
_FIRST_BAND, _BAND = 0.5, 0.25  # about limits, see limit_dynamics()
_VIEW_BAND = 0.35  # rad, likewise, see keep_in_view()
_ANGLE_WEIGHT = 1e-4
# Costs of what a step cannot avoid: s per rad, per m, per m/s. Laps are compared by
# the worst of each, at lower costs: steps aim at none, and miss a little.
_VIEW_COST, _CLEARANCE_COST, _FORWARD_COST = 10.0, 20.0, 1.0
_VIEW_MERIT, _CLEARANCE_MERIT, _FORWARD_MERIT = 3.0, 5.0, 0.5
_EXCESS_COST, _EXCESS_MERIT = 6.0, 3.0  # likewise of all of a limit, in durations
_VIEW_MARGIN = np.deg2rad(1.5)  # for what lies between samples
_TOO_NEAR = 0.05  # m, that no lap may lack


@dc.dataclass(frozen=True)
class Effort:
    """When an optimisation ends."""

    iterations: int = 15  #: at most, of convex programs
    #: Predicted gain of an iteration, as a share of the lap time, at which to stop.
    tolerance: float = 5e-4
    samples: int = 24  #: of each leg
    caution: float = 1.0  #: times the weight of the proximal cost in the first step


# For planning in flight, from a lap through gates that moved a little.
IN_FLIGHT = Effort(iterations=3, tolerance=2e-3, samples=40)


class LapSearch:
    """Sequential convex programming from a lap to the quickest one near it.

    Attributes:
        gates: to pass; of an open lap, with both ends.
        turn: see LapSamples.of().
        constraints: to keep.
        view: half of the camera's view, less a margin (rad); pi if nothing needs to be seen.
        grid: where legs are sampled.
        firmness: weight of stretch_cost(), times that of the proximal cost.
    """

    def __init__(
        self,
        gates: GateRegions,
        turn: float,
        constraints: FlightConstraints,
        grid: Grid,
        firmness: float = 0.0,
    ):
        """Args: see above."""
        self.gates, self.turn, self.constraints = gates, turn, constraints
        half_view = constraints.half_view
        margin = _VIEW_MARGIN if half_view < np.pi else 0.0
        self.view = max(half_view - margin, half_view / 2)
        self.grid, self.firmness = grid, firmness

    def settled(self, lap: LapSpline, samples: int | None = None) -> LapSamples:
        """Returns a lap slowed to the limits, an open one as it is if that is better, or in motion.

        Args: lap: to slow. samples: of each leg, by default those of the search.

        Raises:
            TrajectoryOptimizationError: if it cannot be slowed enough.
        """
        grid = self.grid if samples is None else Grid(lap.pieces, samples)
        of = lap, grid, self.constraints.limits, self.turn
        found = [slowed(*of)] if lap.can_be_slowed else []
        found += [] if lap.is_closed else [LapSamples.of(*of)]
        return min(found, key=self.merit) if len(found) > 1 else found[0]

    def improve(self, now: LapSamples, warm: bool, effort: Effort) -> tuple[LapSamples, int]:
        """Returns a better lap, and the number of iterations; warm if it starts near the best."""
        weight, band = (_WARM_WEIGHT, _BAND) if warm else (_FIRST_WEIGHT, _FIRST_BAND)
        weight *= effort.caution
        merit, least, iteration = self.merit(now), 0.0, 0
        for iteration in range(1, effort.iterations + 1):
            step = self.program(now, weight, band)
            new = step.solve()
            if new is None:
                weight *= 10.0
            else:
                try:
                    after = self.settled(new)
                    after_merit = self.merit(after)
                except TrajectoryOptimizationError:
                    after_merit = np.inf
                predicted = merit - new.duration - _EXCESS_MERIT * merit * step.excess_found()
                gain = merit - after_merit
                ratio = gain / max(predicted, 1e-9)
                small = predicted < effort.tolerance * merit
                if gain > 0.0:
                    now, merit, band = after, after_merit, _BAND
                if small:
                    break
                if ratio < 0.3:
                    weight, least = 4.0 * weight, 2.0 * weight
                elif ratio > 0.7:
                    weight = max(0.2 * weight, least)
                    least *= 0.5
            if weight > _MAX_WEIGHT:
                break
        return now, iteration

    def program(self, now: LapSamples, weight: float, band: float = _BAND) -> LapStep:
        """Returns the convex program of one iteration, to be added to and solved: see LapStep.

        Args:
            now: the lap to start from.
            weight: of the proximal cost.
            band: of limits that are looked at, see limit_dynamics().
        """
        step = LapStep(now, self.grid)
        if not now.lap.is_closed:
            step.excess = [step.slack(_EXCESS_COST * now.lap.duration) for _ in range(2)]
        for i in now.lap.passed:
            place = now.lap.gates[i, 0, :3]
            self.gates.constrain(step.program, i, step.at_gate(i, 0)[0], place)
        limit_dynamics(step, band)
        keep_clear(step, self.constraints, _CLEARANCE_COST)
        cross_forward(step, self.gates, _FORWARD_COST)
        keep_in_view(step, self.gates, self.view, _VIEW_COST, _VIEW_BAND)
        proximal_cost(step, weight)
        if self.firmness > 0.0:
            stretch_cost(step, self.firmness * weight)
        angle_cost(step, _ANGLE_WEIGHT)
        return step

    def merit(self, samples: LapSamples) -> float:
        """Returns what a lap takes and what it lacks (s); less is better."""
        lack = shortfall(samples.lap, self.constraints)
        merit = samples.lap.duration + _CLEARANCE_MERIT * lack
        # Transitions, whose ends are in motion, are refused instead: several are tried.
        if samples.lap.can_be_slowed:
            merit += _FORWARD_MERIT * sideways(samples.lap, self.gates)
        merit += _VIEW_MERIT * out_of_view(samples, self.gates, self.view)
        if not samples.lap.is_closed:
            merit += _EXCESS_MERIT * samples.lap.duration * max(samples.excess(), 0.0)
        return merit

    def require_clear(self, samples: LapSamples) -> None:
        """Raises TrajectoryOptimizationError if the lap comes too near to anything."""
        lack = shortfall(samples.lap, self.constraints)
        if lack > _TOO_NEAR:
            clearance = np.min(self.constraints.clearance, initial=np.inf)
            raise TrajectoryOptimizationError(
                f"No flight found keeps {clearance:.2f} m clear of all pylons and the least "
                f"height of {self.constraints.min_height:.2f} m; the best lacks {lack:.2f} m."
            )
