"""The solution of a planning problem, and when its plan is refused: values in, a value out."""

import contextlib
import dataclasses as dc
import time as wall_clock

import numpy as np
from threadpoolctl import ThreadpoolController

from airrace.systems.planning.lap_plan import NO_PLAN, LapPlan, PlanSummary
from airrace.systems.planning.laps import LapProblem, Laps
from airrace.systems.planning.min_snap_laps import MinSnapLaps
from airrace.systems.planning.time_optimal_laps import TimeOptimalLaps
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.feasibility import check_flight, sample_times
from airrace.trajopt.min_snap.circuit import Circuit
from airrace.vehicle import GRAVITY
from airrace.vehicle.air import as_air

_WORSE = 0.01  # of the bound, by which a plan from the lap before may fall behind that lap
_LEAST_GAIN = 1e-3  # s: less is no reason for another plan, since the way onto it may cost more
_SLOWER = (0.8, 0.6, 0.4)  # of speed and acceleration, tried in turn
_NUMPY = ThreadpoolController()


# Threads share the terms of a sum among them, so its last digits would depend on how many
# cores a computer has.
@_NUMPY.wrap(limits=1, user_api="blas")
def plan_lap(problem: LapProblem) -> LapPlan | None:
    """Returns the plan from the problem's start on, or None to go on with the old one.

    The same problem gives the same plan, but for the time that it took. There is none
    if no lap, or no transition onto it, was found. Unless the problem says ``always``, a new
    plan is refused if the old one is no slower and still leads through the gates as they are
    known now.

    A lap that is too quick to be entered from hover is no first lap: then it is a slower one, with
    a share of the speed and the acceleration, and quicker ones follow in flight.
    """
    plan = _plan(problem)
    if problem.old is NO_PLAN:
        for share in _SLOWER:
            plan = plan or _plan(_slower(problem, share))
    return plan


def _slower(problem: LapProblem, share: float) -> LapProblem:
    """Returns a problem with a share of its speed and acceleration."""
    limits = problem.limits
    level = np.sqrt(max(limits.max_specific_force**2 - GRAVITY**2, 0.0))  # at level flight
    slower = dc.replace(
        limits,
        max_speed=share * limits.max_speed,
        max_acceleration=share * min(limits.max_acceleration, level),
    )
    return dc.replace(problem, limits=slower)


def _plan(problem: LapProblem) -> LapPlan | None:
    """Returns a plan within the limits of the problem; see plan_lap()."""
    clock = wall_clock.perf_counter()
    old = problem.old
    try:
        is_optimal = problem.trajectory == "optimal"
        laps = TimeOptimalLaps(problem) if is_optimal else MinSnapLaps(problem)
        found, bound = _best_laps(laps, old, problem.always)
    except TrajectoryOptimizationError:
        return None
    for circuit in found:
        with contextlib.suppress(TrajectoryOptimizationError):
            entry, phase = laps.transition(circuit, problem.start, problem.remaining)
            break
    else:
        return None
    samples = np.hstack([each.sample(sample_times(each, 1000.0)) for each in (entry, circuit)])
    check = check_flight(samples, problem.pylons, laps.constraints.limits)
    own, air = getattr(circuit, "summary", None), as_air(problem.air)
    summary = PlanSummary(
        solve_time=wall_clock.perf_counter() - clock,
        duration=circuit.duration,
        max_speed=check.max_speed,
        max_acceleration=check.max_acceleration,
        max_rotor_thrust=max(check.max_thrusts),
        max_thrusts=check.max_thrusts,
        min_thrusts=check.min_thrusts,
        max_rate=check.max_rate,
        clearance=check.clearance,
        margin=float(np.max(problem.margins, initial=0.0)),
        active_limits=check.active_limits,
        bound=bound,
        solver=laps.solver,
        iterations=own and own.iterations,
        warm=bool(own and own.warm),
        rotor_factors=_rounded(*problem.rotor_factors),
        drag=_rounded(air.linear, air.quadratic),
        wind=_rounded(*air.wind),
    )
    lap = 1 if old is NO_PLAN else old.lap_at(problem.start_time) + 1
    return LapPlan(lap, problem.start_time, entry, circuit, phase, summary)


def _rounded(*numbers: float) -> tuple:
    """Returns numbers that are multiples of a step, as they are written."""
    return tuple(round(float(each), 6) for each in numbers)


def _best_laps(laps: Laps, old: LapPlan, always: bool = False) -> tuple[list[Circuit], float]:
    """Returns the laps to fly, the quickest first, and their bound; none to stay with the old.

    A lap is judged beside the bound, since gates that moved explain as much. One that
    started from the old lap and fell behind it is searched for again from nothing. Where nothing
    leads onto the quickest, the other is flown. With always, there is a new one in any case.
    """
    bound = laps.point_mass_lap.duration
    if old is NO_PLAN:
        return [laps.lap(None)], bound
    found = []
    with contextlib.suppress(TrajectoryOptimizationError):
        found.append(laps.lap(old.circuit))
    gap = old.summary.gap
    if not found or (gap is not None and found[0].duration > (gap + 1.0 + _WORSE) * bound):
        with contextlib.suppress(TrajectoryOptimizationError):
            found.append(laps.lap(None))
    found.sort(key=lambda lap: lap.duration)
    quicker = [lap for lap in found if lap.duration <= old.circuit.duration - _LEAST_GAIN]
    stays = not always and len(quicker) < len(found) and laps.fits(old.circuit)
    return (quicker if stays else found), bound
