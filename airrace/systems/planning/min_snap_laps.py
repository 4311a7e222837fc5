"""Minimum-snap laps of a planning problem."""

import dataclasses as dc

import numpy as np

from airrace.systems.planning.laps import LapProblem, Laps
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.feasibility import peaks, sample_times
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.flight_limits import FlightConstraints
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.min_snap.circuit import REST_BEYOND, Circuit, LapStyle, plan_circuit
from airrace.trajopt.min_snap.transition import (
    plan_transition_between_laps,
    plan_transition_from_hover,
)
from airrace.vehicle import GRAVITY

_MAX_SPEED = 100.0  # m/s, where there is no limit: time allocation needs one
_EXACT, _SOFT = "SNOPT", "BOBYQA"  # what finds durations
_SHARES = (1.0, 0.8, 0.6)  # of the lap's own speed and acceleration, for the transition onto it


class MinSnapLaps(Laps):
    """Finds minimum-snap laps through the midpoints, see plan_circuit().

    Where no lap of soft limits is clear of the pylons, it finds the quickest one.
    """

    def __init__(self, problem: LapProblem, dimensions: int | None = None):
        """Args: problem: see Laps. dimensions: 3, 4 or 6; by default the problem's."""
        super().__init__(problem)
        self._dimensions = dimensions or int(problem.trajectory)
        self.solver = _SOFT if problem.style.soft else _EXACT

    def _gate_regions(self) -> GateRegions:
        gates = self._problem.gates
        points = [g.p_WG for g in gates]
        if self._problem.style.rests and gates:
            forward = np.array([np.cos(gates[0].heading), np.sin(gates[0].heading), 0.0])
            points[0] = points[0] + REST_BEYOND * forward
        return GateRegions.balls(points, [g.heading for g in gates], 0.0)

    def lap(self, previous: Circuit | None) -> Circuit:
        style = self._problem.style
        try:
            return self._lap(previous, style)
        except TrajectoryOptimizationError:
            if not style.soft:
                raise
            # With the original's time allocation, which knew of no pylons, none is clear of them.
            self.solver = _EXACT
            return self._lap(previous, dc.replace(style, soft=False))

    def _lap(self, previous: Circuit | None, style: LapStyle) -> Circuit:
        # What thrusts hold against gravity, at level flight.
        limits = self._problem.limits
        level = np.sqrt(limits.max_specific_force**2 - GRAVITY**2)
        return plan_circuit(
            [g.p_WG for g in self._problem.gates],
            self.gates.headings,
            self._dimensions,
            self._limited(min(limits.max_speed, _MAX_SPEED), min(limits.max_acceleration, level)),
            previous=previous,
            style=style,
        )

    def transition(
        self, circuit: Circuit, start: np.ndarray, remaining: float | None
    ) -> tuple[FlatTrajectory, float]:
        # Where there is no limit, or a soft one, that is what the lap has.
        soft = self._problem.style.soft
        limits = [
            limit if np.isfinite(limit) and not (soft and limit < peak) else 1.01 * peak
            for limit, peak in zip(
                (self._problem.limits.max_speed, self._problem.limits.max_acceleration),
                peaks(circuit.sample(sample_times(circuit))),
            )
        ]
        if remaining is not None:
            constraints = self._limited(*limits)
            return plan_transition_between_laps(start, circuit, remaining, constraints), 0.0
        for share in _SHARES:
            constraints = self._limited(*(share * limit for limit in limits))
            try:
                return plan_transition_from_hover(start, circuit, self._dimensions, constraints)
            except TrajectoryOptimizationError as e:
                fault = e
        raise fault

    def _limited(self, max_speed: float, max_acceleration: float) -> FlightConstraints:
        limits = dc.replace(
            self.constraints.limits, max_speed=max_speed, max_acceleration=max_acceleration
        )
        return dc.replace(self.constraints, limits=limits)
