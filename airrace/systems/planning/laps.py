"""The planning problem of a lap, and what finds laps and transitions for it."""

import abc
import dataclasses as dc
import functools
from typing import NamedTuple

import numpy as np

from airrace.common.immutable import Immutable
from airrace.systems.planning.lap_plan import NO_PLAN, LapPlan
from airrace.systems.planning.map_margins import largest_move
from airrace.trajopt.feasibility import clearance_of, pylon_distances, sample_times
from airrace.trajopt.flat_trajectory import FlatTrajectory, flat_outputs
from airrace.trajopt.flatness import inverse_dynamics
from airrace.trajopt.flight_limits import FlightConstraints, FlightLimits
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.min_snap.circuit import Circuit, LapStyle
from airrace.trajopt.time_optimal.point_mass import PointMassBound, point_mass_bound

_SLACK = 0.05  # m, by which an old lap may miss what is asked of a new one
_EXCESS = 1e-3  # of a rotor's limit, likewise
# s: by which a transition may begin later; for which the old plan must ask little of the rotors
# from there on; and that must be left to gate 1.
_LATER, _EASY, _LEFT = 0.5, 0.1, 0.4
_SAMPLES = 25  # of the old plan
_WORTH = 0.02  # of the rotors' limits: for less, none begins later


class PlanRequest(NamedTuple):
    """What is new from one LapProblem of a race to the next; see there."""

    start_time: float
    gates: tuple
    pylons: np.ndarray
    margins: np.ndarray
    start: np.ndarray
    old: LapPlan
    rotor_factors: np.ndarray
    air: np.ndarray


@dc.dataclass(frozen=True, eq=False)
class LapProblem(Immutable):
    """All that a plan depends on, so that any process can find it."""

    trajectory: str  #: "3", "4" or "6" dimensions of minimum snap, or "optimal" in time
    limits: FlightLimits  #: of the vehicle, and those added
    gates: tuple  #: tuple of GateEstimate, in the order of flight
    #: Axes to keep clear of, [x, y], (m, 2) m; first those of the gates, left and right.
    pylons: np.ndarray
    #: Between drone and boards of each, for what map and controller leave, (m,) m.
    margins: np.ndarray
    start_time: float  #: when the plan comes into force (s)
    #: Value and four derivatives of x, y, z (m) and yaw (rad) at that time, (5, 4); at rest, if
    #: there is no old plan.
    start: np.ndarray
    old: LapPlan  #: the LapPlan in force until then, NO_PLAN before the first
    #: Of each rotor's thrust, by which ``limits`` differ from the vehicle's file, (n,).
    rotor_factors: np.ndarray
    air: np.ndarray  #: vector of the Air that is in ``limits``, (7,)
    style: LapStyle = LapStyle()  #: of minimum-snap laps
    #: Whether a new plan is flown even if the old one is quicker and still fits.
    always: bool = False

    @property
    def request(self) -> PlanRequest:
        """What a planner of the same race makes this problem of."""
        return PlanRequest(*(getattr(self, name) for name in PlanRequest._fields))

    @property
    def remaining(self) -> float | None:
        """Of the old plan, from the start to gate 1 (s); None if there is no old plan."""
        old = self.old
        return None if old is NO_PLAN else old.next_start(self.start_time) - self.start_time

    def old_share(self, duration: float, delay: float = 0.0) -> float:
        """Returns which share of the rotors' limits the old plan asks for.

        Args: duration: (s). delay: from the start to the time from which on it counts (s).
        """
        times = self.start_time + delay + np.linspace(0.0, duration, _SAMPLES)
        samples = np.transpose([flat_outputs(self.old.derivatives(t)) for t in times])
        thrusts, _ = inverse_dynamics(samples, self.limits.vehicle, self.limits.air)
        return float(np.max(thrusts / self.limits.vehicle.max_thrusts[:, None]))

    def from_where_it_is_easy(self, period: float) -> "LapProblem":
        """Returns the problem whose start is later if the old plan asks less of the rotors there.

        In air, or with rotors, that are not what it was planned for, an old plan may ask for more
        than there is. A transition begins like it, so it would have to ask for as much.

        Args: period: of the times that it may start at (s).
        """
        if self.remaining is None:
            return self
        most = max(min(_LATER, self.remaining - _LEFT), 0.0)
        delays = period * np.arange(int(most / period) + 1)
        shares = [max(self.limits.thrust_share, self.old_share(_EASY, d)) for d in delays]
        if shares[0] - min(shares) < _WORTH:
            return self
        time = self.start_time + float(delays[np.argmin(shares)])
        return dc.replace(self, start_time=time, start=self.old.derivatives(time))

    def has_same_lap(self, other: "LapProblem") -> bool:
        """Whether another problem is of the very same gates, rotors and air."""
        return (
            [gate.number for gate in self.gates] == [gate.number for gate in other.gates]
            and largest_move(self.gates, other.gates) == 0.0
            and np.array_equal(self.pylons, other.pylons)
            and np.array_equal(self.margins, other.margins)
            and np.array_equal(self.rotor_factors, other.rotor_factors)
            and np.array_equal(self.air, other.air)
        )


class Laps(abc.ABC):
    """Finds laps of one kind for a LapProblem, and transitions onto them.

    Attributes:
        solver: its name.
        constraints: FlightConstraints of the laps.
        gates: GateRegions, where the laps cross the gates.
    """

    solver: str

    def __init__(self, problem: LapProblem):
        """Args: problem: to solve. Raises TrajectoryOptimizationError if there can be no lap."""
        self._problem = problem
        problem.limits.check()
        clearance = clearance_of(problem.limits.vehicle.radius, problem.margins)
        self.constraints = FlightConstraints(problem.pylons, clearance, problem.limits)
        self.gates = self._gate_regions()

    @abc.abstractmethod
    def _gate_regions(self) -> GateRegions:
        """Returns where the gates may be crossed."""

    @abc.abstractmethod
    def lap(self, previous: Circuit | None) -> Circuit:
        """Returns a lap, searched for from a previous one if there is one.

        Raises:
            TrajectoryOptimizationError: if none was found.
        """

    @abc.abstractmethod
    def transition(
        self, circuit: Circuit, start: np.ndarray, remaining: float | None
    ) -> tuple[FlatTrajectory, float]:
        """Returns the quickest transition onto a lap, and when on the lap it joins (s).

        Args:
            circuit: the lap.
            start: value and four derivatives of x, y, z (m) and yaw (rad), (5, 4).
            remaining: of the lap before, from there to gate 1 (s); None from hover.

        Raises:
            TrajectoryOptimizationError: if there is none.
        """

    @functools.cached_property
    def point_mass_lap(self) -> PointMassBound:
        """The quickest lap of a point mass."""
        return point_mass_bound(self.gates, self.constraints)

    def fits(self, circuit: Circuit) -> bool:
        """Whether a lap leads through the gates, and clear of pylons, as they are known now.

        And whether the rotors, as strong as they are thought to be, have what it asks.
        """
        crossed = np.array([circuit.derivatives(t)[0, :3] for t in circuit.gate_times[:-1]])
        if crossed.shape != self.gates.midpoints.shape:
            return False
        missed = np.linalg.norm(self.gates.nearest(crossed) - crossed, axis=1)
        samples = circuit.sample(sample_times(circuit, 1000.0))
        distances = pylon_distances(samples, self.constraints.pylons)
        limits = self.constraints.limits
        thrusts, _ = inverse_dynamics(samples, limits.vehicle, limits.air)
        if np.any(thrusts.max(axis=1) > (1.0 + _EXCESS) * limits.max_thrusts):
            return False
        return bool(
            missed.max() <= _SLACK and np.all(distances >= self.constraints.clearance - _SLACK)
        )
