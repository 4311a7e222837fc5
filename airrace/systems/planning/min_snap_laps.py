"""Minimum-snap laps of a planning problem."""

import numpy as np

from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.flight_limits import FlightLimits
from airrace.trajopt.flyable import clearance_of, peaks, pylon_distances, sample_times
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.min_snap.circuit import Circuit, plan_circuit
from airrace.trajopt.min_snap.transition import plan_change, plan_start
from airrace.trajopt.time_optimal.optimal_lap import quickest_point_mass
from airrace.vehicle import GRAVITY

_MOST_SPEED = 100.0  # m/s, where there is no limit: time allocation needs one
_SHARES = (1.0, 0.8, 0.6)  # of the lap's own speed and acceleration, for the way onto it
_SLACK = 0.05  # m, by which an old lap may miss a midpoint


class MinSnapLaps:
    """Finds minimum-snap laps through the midpoints, and ways onto them: see plan_circuit().

    Attributes:
        limits: FlightLimits of the vehicle and those added.
        solver: its name.
    """

    solver = "SNOPT"

    def __init__(self, problem, dimensions: int):
        """Args: problem: a LapProblem. dimensions: 3, 4 or 6."""
        self._problem, self._dimensions = problem, dimensions
        self.limits = FlightLimits(
            problem.vehicle,
            thrust_share=problem.thrust_share,
            max_speed=problem.max_speed,
            max_acceleration=problem.max_acceleration,
        )
        self.limits.check()
        self._midpoints = np.array([g.p_WG for g in problem.gates]).reshape(-1, 3)
        self._headings = [g.heading for g in problem.gates]
        self._options = dict(
            clearance=clearance_of(problem.vehicle.radius, problem.margins), rotors=self.limits
        )
        # What thrusts hold against gravity, at level flight.
        force = self.limits.max_specific_force
        self._ceilings = dict(
            max_speed=min(problem.max_speed, _MOST_SPEED),
            max_acceleration=min(problem.max_acceleration, np.sqrt(force**2 - GRAVITY**2)),
        )

    def bound(self) -> float:
        """Returns the lap time of a point mass through the midpoints (s)."""
        gates = GateRegions.balls(self._midpoints, self._headings, 0.0)
        return quickest_point_mass(
            gates, self.limits, self._problem.pylons, self._options["clearance"]
        ).duration

    def lap(self, previous: Circuit | None) -> Circuit:
        """Returns a lap, sought from a previous one if there is one; or raises."""
        return plan_circuit(
            self._midpoints,
            self._headings,
            self._problem.pylons,
            self._dimensions,
            previous=previous,
            **self._ceilings,
            **self._options,
        )

    def fits(self, circuit: Circuit) -> bool:
        """Whether a lap leads through the gates as they are now."""
        passed = np.array([circuit.derivatives(t)[0, :3] for t in circuit.gate_times[:-1]])
        if passed.shape != self._midpoints.shape:
            return False
        distances = pylon_distances(circuit.sample(sample_times(circuit)), self._problem.pylons)
        return bool(
            np.linalg.norm(passed - self._midpoints, axis=1).max() <= _SLACK
            and np.all(distances >= self._options["clearance"] - _SLACK)
        )

    def way(self, circuit: Circuit, start, remaining) -> tuple[FlatTrajectory, float]:
        """Returns a way onto a lap, and when on the lap it joins (s): see OptimalLaps.way()."""
        limits = self._limits_of(circuit)
        if remaining is not None:
            way = plan_change(
                start, circuit, remaining, self._problem.pylons, **limits, **self._options
            )
            return way, 0.0
        for share in _SHARES:
            scaled = {name: share * limit for name, limit in limits.items()}
            try:
                return plan_start(
                    start,
                    circuit,
                    self._dimensions,
                    self._problem.pylons,
                    **scaled,
                    **self._options,
                )
            except TrajectoryOptimizationError as e:
                fault = e
        raise fault

    def _limits_of(self, circuit: Circuit) -> dict:
        """Returns the limits of speed and acceleration; what the lap has, where there are none."""
        speed, acceleration = peaks(circuit.sample(sample_times(circuit)))
        problem = self._problem
        return dict(
            max_speed=problem.max_speed if np.isfinite(problem.max_speed) else 1.01 * speed,
            max_acceleration=problem.max_acceleration
            if np.isfinite(problem.max_acceleration)
            else 1.01 * acceleration,
        )
