"""Time-optimal laps of a planning problem."""

import contextlib
import functools

import numpy as np

from airrace.systems.planning.min_snap_laps import MinSnapLaps
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.flight_limits import FlightLimits
from airrace.trajopt.flyable import clearance_of, pylon_distances
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.min_snap.circuit import Circuit
from airrace.trajopt.plan_summary import check_times
from airrace.trajopt.time_optimal.optimal_lap import plan_optimal_circuit, quickest_point_mass
from airrace.trajopt.time_optimal.optimal_transition import plan_optimal_way
from airrace.trajopt.time_optimal.point_mass import PointMassBound

_SHARE = 0.99  # of the limits: the way onto the lap has a little more than the lap
_HALF_HEIGHT = 2.5  # m, above and below a gate's midpoint
_STARTS, _CHANGES = (3, 2, 4), (2, 3, 1)  # gates at which a way joins the lap, tried in turn
_MOST_LOST = 2.0  # s, on a way without a loop, beside the guessed time to gate 1 and the lap's on
_LOOKS = 50  # at the rest of the old lap
_SLACK = 0.05  # m, by which an old lap may miss what is asked of a new one


class OptimalLaps:
    """Finds laps anywhere through the gates, and ways onto them: see plan_optimal_circuit().

    Attributes:
        limits: FlightLimits of the vehicle and those added.
        solver: its name.
    """

    solver = "Clarabel"

    def __init__(self, problem):
        """Args: problem: a LapProblem. Raises TrajectoryOptimizationError if it has no room."""
        self._problem = problem
        self._clearance = clearance_of(problem.vehicle.radius, problem.margins)
        gates = problem.gates
        # Of a gate's two pylons the one that is known less says how near to come.
        each = self._clearance[: 2 * len(gates)].reshape(-1, 2).max(axis=1)
        self._gates = GateRegions.windows(
            [g.p_WG for g in gates],
            [g.heading for g in gates],
            [g.spacing / 2 - clearance for g, clearance in zip(gates, each)],
            _HALF_HEIGHT,
        )
        self.limits = FlightLimits(
            problem.vehicle,
            thrust_share=problem.thrust_share,
            max_speed=problem.max_speed,
            max_acceleration=problem.max_acceleration,
        )
        self.limits.check()

    def bound(self) -> float:
        """Returns the lap time of a point mass (s)."""
        return self._bound.duration

    @functools.cached_property
    def _bound(self) -> PointMassBound:
        return quickest_point_mass(self._gates, self.limits, self._problem.pylons, self._clearance)

    def lap(self, previous: Circuit | None) -> Circuit:
        """Returns a lap, sought from a previous one if there is one; or raises."""
        return plan_optimal_circuit(
            self._gates,
            self._problem.pylons,
            self.limits.scaled(_SHARE),
            clearance=self._clearance,
            previous=previous,
            bound=self._bound,
        )

    def fits(self, circuit: Circuit) -> bool:
        """Whether a lap leads through the gates as they are now."""
        crossed = np.array([circuit.derivatives(t)[0, :3] for t in circuit.gate_times[:-1]])
        if crossed.shape != self._gates.midpoints.shape:
            return False
        missed = np.linalg.norm(self._gates.nearest(crossed) - crossed, axis=1)
        distances = pylon_distances(circuit.sample(check_times(circuit)), self._problem.pylons)
        return bool(missed.max() <= _SLACK and np.all(distances >= self._clearance - _SLACK))

    def way(self, circuit: Circuit, start, remaining) -> tuple[FlatTrajectory, float]:
        """Returns the quickest way onto a lap, and when on the lap it joins (s).

        Args:
            circuit: the lap.
            start: value and four derivatives of x, y, z (m) and yaw (rad), (5, 4).
            remaining: of the lap before, from there to gate 1 (s); None from rest.

        Raises:
            TrajectoryOptimizationError: if there is none.
        """
        joins = [
            k
            for k in (_STARTS if remaining is None else _CHANGES)
            if k < len(circuit.gate_times) - 1
        ]
        first = remaining
        if first is None:
            gate = circuit.derivatives(0.0)
            first = 2.0 * np.linalg.norm(gate[0, :3] - start[0, :3]) / np.linalg.norm(gate[1, :3])
            clearance, old = self._clearance, None
        else:
            # It may start where the old plan comes nearer than is asked of a new one.
            clearance = np.minimum(self._clearance, self._distances_on(remaining))
            old = self._old
        tries = [(k, old) for k in joins] + ([(joins[0], None)] if old else [])
        found = []  # with what is lost on them (s)
        for k, old in tries:
            legs = np.diff(circuit.gate_times)[: k - 1]
            with contextlib.suppress(TrajectoryOptimizationError):
                way, phase = plan_optimal_way(
                    start,
                    [first, *legs],
                    self._gates,
                    circuit,
                    self._problem.pylons,
                    self.limits,
                    clearance=clearance,
                    old=old,
                )
                found.append((way.duration - phase - first, way, phase))
                # A search may end with a loop before a gate: no way near it is quicker.
                if found[-1][0] <= _MOST_LOST:
                    break
        if found:
            _, way, phase = min(found, key=lambda each: each[0])
            return way, phase
        # From odd places, or at the last moment.
        return MinSnapLaps(self._problem, 4).way(circuit, start, remaining)

    def _old(self, time) -> np.ndarray:
        """Returns where the old plan leads to after a time, as in LapPlan.derivatives()."""
        return self._problem.old.derivatives(self._problem.start_time + time)

    def _distances_on(self, remaining) -> np.ndarray:
        """Returns how near the old plan comes to each pylon on the way to gate 1, (m,) m."""
        places = [self._old(t)[0, :3] for t in np.linspace(0.0, remaining, _LOOKS)]
        return pylon_distances(np.transpose(places), self._problem.pylons).min(axis=0)
