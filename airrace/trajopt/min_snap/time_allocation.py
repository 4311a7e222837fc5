"""Time allocation: how long every segment of a minimum-snap trajectory takes."""

import contextlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.solvers import MathematicalProgram, SnoptSolver

from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.min_snap.limits import LimitSamples, slowdown_factor
from airrace.trajopt.min_snap.min_snap import MinSnapProblem

_SAMPLES, _FINE_SAMPLES = 12, 64  # of a segment: to optimise, and to polish


def durations_within_limits(
    problem: MinSnapProblem,
    durations: ArrayLike,
    limits: ArrayLike,
    *,
    min_factor: float = 0.7,
    max_factor: float = 4.0,
) -> np.ndarray:
    """Returns the shortest multiple of the durations that meets the limits.

    If the trajectory keeps its shape, the factor follows from its excess. Otherwise it
    is searched upwards, solving anew for every factor.

    Args:
        problem: of x, y, z, and more or less.
        durations: (segments,) s, like those returned.
        limits: of speed (m/s) and acceleration (m/s^2), of their norms, without gravity.
        min_factor: the least factor, even where the limits allow less.
        max_factor: where the search, if there is one, gives up.

    Raises:
        ValueError: if the input is malformed.
        TrajectoryOptimizationError: if no factor meets the limits.
    """
    durations, limits = np.array(durations, float), _checked(limits, problem)
    problem.require_unique()

    def excess(factor):
        return slowdown_factor(problem, factor * durations, limits) - 1.0

    if problem.keeps_shape:
        return durations * max(min_factor, (1.0 + excess(1.0)) * (1.0 + 1e-8))
    low = high = min_factor
    step, at_high = 0.01, excess(high)
    while at_high > 1e-12:
        low, high, step = high, high * (1.0 + step), min(1.5 * step, 0.1)
        if high > max_factor:
            raise TrajectoryOptimizationError(
                f"No {min_factor:g} to {max_factor:g} fold of these durations meets "
                f"{_in_words(limits)}; relax them or the fixed derivatives."
            )
        at_high = excess(high)
    if low < high and at_high < -1e-7:
        # A little within the limits, so that they are met in spite of rounding.
        from scipy.optimize import brentq  # here, as few races need it: it takes 0.3 s

        high = brentq(lambda factor: excess(factor) + 5e-8, low, high, xtol=1e-8)
    return durations * high


def allocate_times(
    waypoints: ArrayLike,
    *,
    max_speed: float,
    max_acceleration: float,
    initial_durations: ArrayLike | None = None,
    **options: Any,
) -> np.ndarray:
    """Returns the segment durations (s) that make the trajectory the fastest.

    They minimise the total duration, not the snap, such that the minimum-snap
    trajectory keeps to the limits: a nonlinear program in the durations alone.
    It constrains samples, with exact gradients from the linear equations of the
    minimum; at last a common factor makes the trajectory touch a limit.

    Laps through free waypoints have one local minimum, as far as seen; fixed
    derivatives in between make many. Then it also starts from the solution
    without those, and from perturbations of the best, always the same ones.
    A lap through a waypoint where all derivatives are fixed starts and ends there.

    Args:
        waypoints, options: see MinSnapProblem(); only the first three dimensions matter.
        max_speed, max_acceleration: limits of the norms of both (m/s), (m/s^2).
        initial_durations: (segments,) s, to start from, without restarts.

    Raises: like durations_within_limits().
    """
    positions = np.array(waypoints, float)[..., :3]
    constraints = [c._replace(value=c.value[:3]) for c in options.pop("constraints", ())]
    if options.get("period_offset") is not None:
        options["period_offset"] = np.array(options["period_offset"], float)[..., :3]
    problem = MinSnapProblem(positions, constraints=constraints, **options)
    limits = _checked([max_speed, max_acceleration], problem)
    ends = problem.ends(problem.values)
    chords = np.linalg.norm(ends[:, len(problem.order) // 2] - ends[:, 0], axis=1)

    def solve(start, problem, polish=False):
        """Returns a list of one solution, or of none."""
        problem.require_unique()
        if problem.keeps_shape:
            start = start * slowdown_factor(problem, start, limits)
        samples = LimitSamples(problem, limits, _FINE_SAMPLES if polish else _SAMPLES)
        values, _ = samples(start)
        rows = np.flatnonzero(values >= (0.9 * values.max() if polish else 0.0))
        for bound in (1.0, 0.99, 0.9):  # on samples: it may be exceeded between them
            durations = _minimize_total(samples, rows, bound, start, chords / limits[0])
            with contextlib.suppress(TrajectoryOptimizationError):
                return [durations_within_limits(problem, durations, limits, min_factor=0.9)]
        return []

    equal_speeds = chords / (0.75 * limits[0])
    slow = 1.5 * np.maximum(chords / limits[0], np.sqrt(2 * chords / limits[1]))
    warm = [] if initial_durations is None else [problem.check_durations(initial_durations)]
    found = []
    for start in [*warm, equal_speeds, slow]:
        found = found or solve(start, problem)
    if not found:
        raise TrajectoryOptimizationError(
            f"No durations found meet {_in_words(limits)}; relax them or the fixed derivatives."
        )
    ends_at = [0, -1, len(chords)]
    if options.get("periodic"):
        ends_at = np.flatnonzero(problem.fixed.reshape(len(positions), -1).all(axis=1)).tolist()
    relaxed = [c for c in constraints if c.waypoint in ends_at]
    if not warm and len(relaxed) < len(constraints):
        loose = MinSnapProblem(positions, constraints=relaxed, **options)
        for start in solve(equal_speeds, loose):
            found += solve(start, problem)
        phase = np.arange(1, len(chords) + 1) * (np.sqrt(5) - 1) / 2  # spread evenly modulo 1
        for k in range(1, 7):
            found += solve(min(found, key=np.sum) * np.exp(k * phase % 1 - 0.5), problem)
    found += solve(min(found, key=np.sum), problem, polish=True)
    return min(found, key=np.sum)


def _minimize_total(samples, rows, bound, start, shortest):
    """Returns durations (s) of a local minimum, or where the solver got stuck."""

    def constraint(T):
        if T.dtype != object:
            return samples(T)[0][rows]
        values, jacobian = samples(ExtractValue(T).ravel())
        return InitializeAutoDiff(values[rows], jacobian[rows] @ ExtractGradient(T)).ravel()

    program = MathematicalProgram()
    T = program.NewContinuousVariables(len(start), "T")
    program.AddLinearCost(np.ones(len(start)), T)
    program.AddBoundingBoxConstraint(shortest, np.full(len(start), 3 * start.sum()), T)
    program.AddConstraint(constraint, np.full(len(rows), -np.inf), np.full(len(rows), bound), T)
    return SnoptSolver().Solve(program, start).GetSolution(T)


def _checked(limits: ArrayLike, problem: MinSnapProblem) -> np.ndarray:
    limits = np.array(limits, float)
    if not np.all((limits > 0) & (limits < np.inf)):
        raise ValueError(f"max_speed and max_acceleration must be positive, not {limits}.")
    amounts = np.linalg.norm(problem.by_waypoint()[:, 1:3, :3], axis=2)
    # Polynomials of a low degree may have no acceleration to fix.
    for waypoint, k in np.argwhere(amounts > (1.0 + 1e-12) * limits[: amounts.shape[1]]):
        raise TrajectoryOptimizationError(
            f"Derivative {k + 1} at waypoint {waypoint} is fixed above its limit."
        )
    return limits


def _in_words(limits: np.ndarray) -> str:
    return f"the limits of {limits[0]:g} m/s and {limits[1]:g} m/s^2"
