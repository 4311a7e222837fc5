"""The planning problem of a lap, and its solution: values in, a value out."""

import contextlib
import dataclasses as dc
import time as wall_clock

import numpy as np

from airrace.common.immutable import Immutable
from airrace.systems.planning.lap_plan import LapPlan, PlanSummary
from airrace.systems.planning.map_margins import largest_move
from airrace.systems.planning.min_snap_laps import MinSnapLaps
from airrace.systems.planning.optimal_laps import OptimalLaps
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.min_snap.circuit import Circuit
from airrace.trajopt.plan_summary import check_flight, check_times
from airrace.vehicle import Vehicle

_WORSE = 0.01  # of the bound, by which a plan from the lap before may fall behind that lap


@dc.dataclass(frozen=True, eq=False)
class LapProblem(Immutable):
    """All that a plan depends on, so that any process can find it.

    Attributes:
        trajectory: "3", "4" or "6" dimensions of minimum snap, or "optimal" in time.
        vehicle: that flies it.
        max_speed, max_acceleration: (m/s), (m/s^2); inf for none.
        thrust_share: of the rotors' limits; the rest is for the controller.
        gates: tuple of GateEstimate, in the order of flight.
        pylons: axes to keep clear of, [x, y], (m, 2) m; first those of the gates, left
            and right.
        margins: between drone and boards of each, for what map and controller leave,
            (m,) m.
        start_time: when the plan comes into force (s).
        start: value and four derivatives of x, y, z (m) and yaw (rad) at that time,
            (5, 4); at rest, if there is no old plan.
        old: the LapPlan in force until then, or None before the first.
    """

    trajectory: str
    vehicle: Vehicle
    max_speed: float
    max_acceleration: float
    thrust_share: float
    gates: tuple
    pylons: np.ndarray
    margins: np.ndarray
    start_time: float
    start: np.ndarray
    old: LapPlan | None

    def asks_for_the_same(self, other: "LapProblem") -> bool:
        """Whether another problem is that of a lap through the very same gates."""
        return (
            [gate.number for gate in self.gates] == [gate.number for gate in other.gates]
            and largest_move(self.gates, other.gates) == 0.0
            and np.array_equal(self.pylons, other.pylons)
            and np.array_equal(self.margins, other.margins)
        )


def plan_lap(problem: LapProblem) -> LapPlan | None:
    """Returns the plan from the problem's start on, or None to go on with the old one.

    The same problem gives the same plan, but for the time that it took. There is none
    if no lap, or no way onto it, was found, or if the old one is quicker and still
    leads through the gates as they are known now.
    """
    clock = wall_clock.perf_counter()
    old = problem.old
    try:
        laps = make_laps(problem)
        circuit, bound = _best_lap(laps, old)
        if circuit is None:
            return None
        remaining = None
        if old is not None:
            remaining = old.next_start(problem.start_time) - problem.start_time
        entry, phase = laps.way(circuit, problem.start, remaining)
    except TrajectoryOptimizationError:
        return None
    report = _report(problem, laps, entry, circuit, bound)
    return LapPlan(
        lap=1 if old is None else old.lap_at(problem.start_time) + 1,
        start_time=problem.start_time,
        entry=entry,
        circuit=circuit,
        phase=phase,
        report=dc.replace(report, solve_time=wall_clock.perf_counter() - clock),
    )


def make_laps(problem: LapProblem):
    """Returns what finds laps of the problem's kind: MinSnapLaps or OptimalLaps.

    Raises:
        TrajectoryOptimizationError: if there can be none.
    """
    if problem.trajectory == "optimal":
        return OptimalLaps(problem)
    return MinSnapLaps(problem, int(problem.trajectory))


def _best_lap(laps, old: LapPlan | None) -> tuple[Circuit | None, float]:
    """Returns the lap to fly and its bound; None to stay with the old.

    A lap is judged beside the bound, since gates that moved explain as much. One that
    started from the old lap and fell behind it is sought again from nothing.
    """
    bound = laps.bound()
    if old is None:
        return laps.lap(None), bound
    found = []
    with contextlib.suppress(TrajectoryOptimizationError):
        found.append(laps.lap(old.circuit))
    as_good = old.report is not None and old.report.bound and old.report.gap + 1.0
    if not found or (as_good and found[0].duration > (as_good + _WORSE) * bound):
        with contextlib.suppress(TrajectoryOptimizationError):
            found.append(laps.lap(None))
    best = min(found, key=lambda lap: lap.duration, default=None)
    if best is not None and best.duration > old.circuit.duration and laps.fits(old.circuit):
        return None, bound
    return best, bound


def _report(problem: LapProblem, laps, entry, circuit: Circuit, bound) -> PlanSummary:
    samples = np.hstack([each.sample(check_times(each)) for each in (entry, circuit)])
    check = check_flight(samples, problem.pylons, laps.limits)
    own = getattr(circuit, "report", None)
    return PlanSummary(
        solve_time=0.0,
        duration=circuit.duration,
        max_speed=check.max_speed,
        max_acceleration=check.max_acceleration,
        max_rotor_thrust=max(check.max_thrusts),
        max_thrusts=check.max_thrusts,
        min_thrusts=check.min_thrusts,
        max_rate=check.max_rate,
        clearance=check.clearance,
        margin=float(np.max(problem.margins, initial=0.0)),
        reached=check.reached,
        bound=bound,
        solver=laps.solver,
        iterations=own and own.iterations,
        warm=bool(own and own.warm),
    )
