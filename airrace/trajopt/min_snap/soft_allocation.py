"""Time allocation with soft limits, as the original Student AirRace system had it.

Its laps came from mav_trajectory_generation (https://github.com/ethz-asl/mav_trajectory_generation,
PolynomialOptimizationNonLinear with its defaults). The cost is that of Burri, Oleynikova, Achtelik
and Siegwart, "Real-time visual-inertial mapping, re-localization and planning onboard MAVs in
previously unknown environments" (IROS 2015), after Richter, Bry and Roy (ISRR 2013).
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydrake.autodiffutils import AutoDiffXd, ExtractValue
from pydrake.solvers import MathematicalProgram, NloptSolver, SolverOptions

from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.min_snap.limits import peak_norms
from airrace.trajopt.min_snap.min_snap import MinSnapProblem
from airrace.trajopt.min_snap.time_allocation import durations_within_limits

_TIME_PENALTY = 500.0  # m^2/s^9, of the squared total duration
_WEIGHT = 100.0  # of a limit's relative violation, in the exponent
_MOST_COST = 1e12  # of a limit's violation
_SHORT = 6.5  # by how much the guess makes short segments longer
_STEP = 0.1  # of every duration, the first step of the search
_TOLERANCE = 0.05  # of the cost: it stops when a step improves less
_MOST_EVALUATIONS = 3000
_SHORTEST = 0.1  # s, of any duration


def guess_durations(chords: np.ndarray, max_speed: float, max_acceleration: float) -> np.ndarray:
    """Returns a first guess of the durations: t = 2 d / v (1 + 6.5 v / a exp(-2 d / v)).

    Args:
        chords: distances d of the waypoints, (segments,) m.
        max_speed, max_acceleration: v (m/s) and a (m/s^2).
    """
    t = 2.0 * chords / max_speed
    return t * (1.0 + _SHORT * max_speed / max_acceleration * np.exp(-t))


def allocate_times_softly(
    waypoints: ArrayLike,
    *,
    max_speed: float,
    max_acceleration: float,
    share: float | None = None,
    **options: Any,
) -> np.ndarray:
    """Returns segment durations (s) that weigh snap against time.

    They minimise the integral of the squared snap of all dimensions + 500 (sum of T)^2
    + for speed and acceleration each, min(10^12, exp(100 (peak / limit - 1))).

    That is searched without gradients, by BOBYQA (Powell 2009), from guess_durations() on, and
    stops as soon as a step improves the cost by less than 5 %: near the guess, as a rule. The
    limits are soft: they may be exceeded.

    Args:
        waypoints, options: see MinSnapProblem().
        max_speed, max_acceleration: limits of the norms of both over x, y, z (m/s), (m/s^2).
        share: of the limits; the durations are stretched until the trajectory keeps it. None:
            they are not.

    Raises: like durations_within_limits().
    """
    problem = MinSnapProblem(waypoints, **options)
    problem.require_unique()
    limits = np.array([max_speed, max_acceleration], float)
    if not np.all((limits > 0.0) & (limits < np.inf)):
        raise ValueError(f"max_speed and max_acceleration must be positive, not {limits}.")
    ends = problem.ends(problem.values)
    chords = np.linalg.norm((ends[:, len(problem.order) // 2] - ends[:, 0])[:, :3], axis=1)
    guess = guess_durations(chords, *limits)
    durations = _search(lambda T: _cost(problem, T, limits), guess)
    if share is None:
        return durations
    return durations_within_limits(problem, durations, share * limits, min_factor=1.0)


def _cost(problem: MinSnapProblem, durations: np.ndarray, limits: np.ndarray) -> float:
    """Returns the cost of durations (s), see allocate_times_softly()."""
    try:
        derivatives = problem.solve_closed_form(durations)
    except TrajectoryOptimizationError:
        return 3.0 * _MOST_COST  # too unlike each other
    segments, _, _ = problem.assemble(durations)
    ends = problem.ends(derivatives)
    snap = np.sum(ends * (segments @ ends))
    peaks = peak_norms(problem.coefficients(durations, derivatives), durations)
    most = np.log(_MOST_COST)
    violations = np.exp(np.minimum(_WEIGHT * (peaks / limits - 1.0), most))
    return float(snap + _TIME_PENALTY * durations.sum() ** 2 + violations.sum())


def _search(cost, guess):
    """Returns durations of about the least cost.

    Of x with T = guess (1 + 0.1 (x - 1)), the search starts at 1, and its first steps are as
    long as that: 10 % of each duration.
    """

    found = []

    def evaluate(x):
        # Drake hands over what could carry gradients, even for a method that asks for none.
        durations = guess * (1.0 + _STEP * (ExtractValue(x).ravel() - 1.0))
        durations = np.maximum(durations, _SHORTEST)
        found.append((cost(durations), durations))
        return AutoDiffXd(found[-1][0])

    program = MathematicalProgram()
    x = program.NewContinuousVariables(len(guess), "x")
    program.AddCost(evaluate, x)
    options = SolverOptions()
    for name, value in {
        NloptSolver.AlgorithmName(): "LN_BOBYQA",
        NloptSolver.FRelativeToleranceName(): _TOLERANCE,
        NloptSolver.XRelativeToleranceName(): 0.0,
        NloptSolver.XAbsoluteToleranceName(): 0.0,
        NloptSolver.MaxEvalName(): _MOST_EVALUATIONS,
    }.items():
        options.SetOption(NloptSolver.id(), name, value)
    NloptSolver().Solve(program, np.ones(len(guess)), options)
    return min(found, key=lambda each: each[0])[1]  # also where rounding stopped the search
