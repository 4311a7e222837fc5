"""Time-optimal transitions onto a time-optimal lap: from hover, and from the lap before."""

import dataclasses as dc
from collections.abc import Callable, Sequence

import numpy as np

from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.feasibility import check_flight, passes_forward, sample_times
from airrace.trajopt.flat_trajectory import FlatTrajectory, flat_outputs
from airrace.trajopt.flatness import attitude_from_force, heading_vectors, thrust_vectors
from airrace.trajopt.flight_limits import FlightConstraints, FlightLimits
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.min_snap.leg import end_constraints
from airrace.trajopt.min_snap.min_snap import solve_min_snap
from airrace.trajopt.reference import as_reference
from airrace.trajopt.time_optimal.lap_samples import Grid, LapSamples
from airrace.trajopt.time_optimal.lap_search import Effort, LapSearch
from airrace.trajopt.time_optimal.lap_spline import ORDERS, LapSpline, basis
from airrace.trajopt.time_optimal.optimal_circuit import OptimalCircuit, flat_polynomial
from airrace.trajopt.time_optimal.thrust_axis_angle import least_rotation_axes
from airrace.vehicle.air import Air

_REFINEMENT = 8  # pieces of yaw to one of the path
# Transitions vary faster than laps, and are short: a small share of one is nothing to the race.
_EFFORT = Effort(tolerance=2e-3)
_FIT_SAMPLES = 24  # of each leg, for its interior control points
_SLOWER = (1.0, 1.3, 1.7)  # guesses of all durations
_LEAST_DURATION = 0.1  # s
# Of the limit of speed, which varies little, and of the others, for what lies between so many
# samples of a leg; tried in turn. More samples, too: where the lap begins it has more than less.
_AIMS = (0.9998, 0.997, 40), (0.9996, 0.993, 64), (0.9994, 0.987, 96)


def plan_optimal_transition(
    start: np.ndarray,
    durations: Sequence[float],
    gates: GateRegions,
    circuit: OptimalCircuit,
    constraints: FlightConstraints,
    *,
    old: Callable[[float], np.ndarray] | None = None,
) -> tuple[FlatTrajectory, float]:
    """Returns the quickest flight from a state through gates 1, ..., k - 1 onto a lap at gate k.

    The search is that of plan_optimal_circuit(), with both ends given: position to
    snap and yaw to its second derivative are those of the start and of the lap.

    Args:
        start: value and four derivatives of x, y, z (m) and yaw (rad), (5, 4).
        durations: guesses, from the start to gate 1, from there to gate 2 ..., (k,) s.
        gates: of the lap, all of them.
        circuit: the lap.
        constraints: of the transition; the lap must be within its limits.
        old: a flight that leads from the start nearly to gate 1, to begin the search
            with: from time to the same as start.

    Returns: (transition, phase): and the time on the circuit at which it is joined (s).

    Raises:
        TrajectoryOptimizationError: if none was found within the limits.
    """
    k = len(durations)
    pieces = circuit.spline.pieces  # so that what is left of a lap is one of the splines
    phase = circuit.gate_times[k - 1]
    goal = circuit.derivatives(phase)
    yaws = np.unwrap([start[0, 3], *gates.headings[: k - 1], goal[0, 3]])
    limits = constraints.limits
    # Position, and the angle about the thrust in the place of yaw.
    ends = [np.column_stack([s[:, :3], _thrust_axis_angle(s, limits.air)]) for s in (start, goal)]
    turn = ends[1][0, 3] - ends[0][0, 3]
    turn += 2 * np.pi * np.round((yaws[-1] - yaws[0] - turn) / (2 * np.pi))
    search = LapSearch(
        gates.first(k, start[0, :3], start[0, 3]), turn, constraints, Grid(pieces, _AIMS[0][-1])
    )
    durations, times = np.asarray(durations), circuit.gate_times[: k - 1]
    if old is None:
        points = [start[0], *(circuit.derivatives(t)[0] for t in times), goal[0]]
        paths = [_smoothest(np.array(points), ends, factor * durations) for factor in _SLOWER]
    else:
        on_lap = [lambda t, begin=begin: circuit.derivatives(begin + t) for begin in times]
        paths = [(durations, [old, *on_lap])]
    guesses = [_guess(*path, ends, pieces) for path in paths]  # type: ignore[call-arg]
    now = min((search.settled(guess) for guess in guesses), key=search.merit)
    warm = old is not None
    for of_speed, aim, samples in _AIMS:
        aimed = dc.replace(limits.scaled(aim), max_speed=of_speed * limits.max_speed)
        search.constraints, search.grid = (
            dc.replace(constraints, limits=aimed),
            Grid(pieces, samples),
        )
        now, _ = search.improve(search.settled(now.lap), warm, _EFFORT)
        warm = True
        transition, excess = _finished(now, search, limits, goal)
        if excess <= 0.0:
            break
    else:
        raise TrajectoryOptimizationError(
            f"No transition onto the lap keeps the limits; the best exceeds them by {excess:.1%}."
        )
    search.require_clear(now)
    times = np.cumsum(now.lap.durations)[:-1]
    if not passes_forward(transition, times, search.gates.headings[1:-1]).all():
        raise TrajectoryOptimizationError("The transition found crosses a gate sideways.")
    return transition, phase


def _thrust_axis_angle(state: np.ndarray, air: Air) -> np.ndarray:
    """Returns the angle about the thrust from the least rotation's axes, and derivatives, (5,)."""
    flat = flat_outputs(state)
    *_, yaw, rate, acceleration = as_reference(flat)
    axes, w, alpha = attitude_from_force(
        *thrust_vectors(flat, air=air),
        heading_vectors(np.cos(yaw), np.sin(yaw), rate, acceleration),
    )
    e1, e2 = least_rotation_axes(axes[2])
    return np.array([np.arctan2(axes[0] @ e2, axes[0] @ e1), w[2], alpha[2], 0.0, 0.0])


def _smoothest(points, ends, durations):
    """Returns durations and legs, see _guess(), of the smoothest path through points."""
    durations = np.maximum(durations, _LEAST_DURATION)
    constraints = end_constraints(*(end[:, :3] for end in ends), (1, 2, 3, 4))
    path = solve_min_snap(points[:, :3], durations, constraints=constraints)
    orders = [path.derivative(order) for order in range(ORDERS)]

    def leg(begin):
        return lambda t: np.hstack([order.value(begin + t) for order in orders]).T

    return durations, [leg(begin) for begin in path.get_segment_times()[:-1]]


def _guess(
    durations: np.ndarray,
    legs: Sequence[Callable[[float], np.ndarray]],
    ends: Sequence[np.ndarray],
    pieces: int,
) -> LapSpline:
    """Returns a path as a spline.

    Args:
        durations: of its legs (s).
        legs: from the time since each began to position and four derivatives, (5, 3 or 4).
        ends: value and four derivatives of position and thrust-axis angle, (5, 4) each.
        pieces: of each leg's spline.
    """
    fractions = np.linspace(0.0, 1.0, _FIT_SAMPLES)
    samples = np.array([[leg(T * x)[:2, :3] for x in fractions] for leg, T in zip(legs, durations)])
    gates = np.zeros((len(legs) + 1, ORDERS, 4))
    gates[0], gates[-1] = ends
    for gate, leg in zip(gates[1:-1], legs[1:]):
        gate[:, :3] = leg(0.0)[:, :3]
    # Angles between are those of an even turn, until the first step.
    breaks = np.cumsum([0.0, *durations])
    turn = ends[1][0, 3] - ends[0][0, 3]
    gates[1:-1, 0, 3] = ends[0][0, 3] + (breaks / breaks[-1])[1:-1] * turn
    lap = LapSpline(gates, np.zeros((len(legs), pieces - ORDERS, 4)), durations, turn)
    wanted = lap.evaluate(basis(pieces, tuple(fractions))[:2])
    for order in (0, 1):
        wanted[order, ..., :3] = durations[:, None, None] ** order * samples[:, :, order]
    return lap.fitted(wanted, fractions, (1.0, 1.0))


def _finished(
    now: LapSamples, search: LapSearch, limits: FlightLimits, goal: np.ndarray
) -> tuple[FlatTrajectory, float]:
    """Returns the transition as a trajectory, and by which share it exceeds limits at 1 kHz."""
    transition = FlatTrajectory(
        flat_polynomial(now.lap, search.constraints.limits, search.turn, _REFINEMENT, goal)
    )
    return transition, check_flight(
        transition.sample(sample_times(transition, 1000.0)), search.constraints.pylons, limits
    ).excess
