"""The circuit: a closed lap through the gates of a map."""

import contextlib
import dataclasses as dc
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike
from pydrake.trajectories import PiecewisePolynomial

from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.feasibility import (
    MAX_CROSSING_ANGLE,
    check_flight,
    is_feasible,
    passes_forward,
    pylon_distances,
    sample_times,
)
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.flight_limits import FlightConstraints, FlightLimits
from airrace.trajopt.gate_regions import GateRegions, turn_per_lap
from airrace.trajopt.min_snap.min_snap import DerivativeConstraint, MinSnapProblem
from airrace.trajopt.min_snap.soft_allocation import allocate_times_softly
from airrace.trajopt.min_snap.time_allocation import allocate_times

# m, from gate 1's midpoint on to where laps rest. In the gate's plane itself, noise would decide
# when the gate counts; 0.5 m beyond it, the drone has passed, and is still between the boards.
REST_BEYOND = 0.5
LEVEL = np.array([0.0, 0.0, np.nan, np.nan])  # no horizontal acceleration
# Of the limits, so that a slightly different transition onto the circuit keeps them.
_MARGIN = 0.99
_APPROACHES = (None, 5.0, 3.0, 2.0, 10.0)  # m before a gate, tried in turn
_MOST_ROUNDS = 4  # of each, with the gates that were faulty in the last
_MOST_SLOWING = 20.0  # times the durations within limits of speed and acceleration
_LEG_SAMPLES = 200  # which bracket where a leg passes its gate


@dc.dataclass(frozen=True)
class LapStyle:
    """What sets laps apart from the quickest ones that never stop."""

    rests: bool = False  #: whether every lap starts and ends at rest, REST_BEYOND gate 1's midpoint
    #: Whether durations weigh snap against time, with soft limits, as those of the original system:
    #: see allocate_times_softly(). Else they are the shortest.
    soft: bool = False


class Circuit(FlatTrajectory):
    """One lap from gate 1 to gate 1, or from rest just beyond gate 1 to rest there.

    Attributes:
        gate_times: when each gate is passed, and then gate 1 again (s): 0 and the duration. If
            it rests, gate 1 is passed a little earlier, the first time before it starts.
        headings: of the gates (rad), as a tuple.
        approach: gate index to distance (m) of a waypoint in front of it.
    """

    def __init__(
        self,
        polynomial: PiecewisePolynomial,
        gate_times: Sequence[float],
        headings: np.ndarray,
        approach: dict,
    ):
        """Args: polynomial: with four rows. The others: see above."""
        super().__init__(polynomial)
        self._set_gates(gate_times, headings, approach)

    def _set_gates(
        self, gate_times: Sequence[float], headings: Sequence[float] | np.ndarray, approach: dict
    ) -> None:
        self.gate_times = tuple(gate_times)
        self.headings = tuple(headings)
        self.approach = approach

    @classmethod
    def of_path(
        cls,
        path: FlatTrajectory,
        gate_times: Sequence[float],
        headings: Sequence[float],
        approach: dict,
    ) -> "Circuit":
        """Returns the lap along a trajectory. Args: the others: see above."""
        circuit = cls.__new__(cls)
        circuit._set_segments(*path.segments)
        circuit._set_gates(gate_times, headings, approach)
        return circuit

    @property
    def waypoint_times(self) -> tuple:
        """When each waypoint is passed, those of gates and those in front of them (s)."""
        return self.breaks

    @property
    def rests(self) -> bool:
        """Whether it starts and ends at rest."""
        return self.gate_times[0] < 0.0


def plan_circuit(
    midpoints: ArrayLike,
    headings: ArrayLike,
    dimensions: int,
    constraints: FlightConstraints,
    *,
    previous: Circuit | None = None,
    style: LapStyle = LapStyle(),
) -> Circuit:
    """Returns the lap through the gates that is shortest within the limits.

    Section V of the Student AirRace paper, as a closed loop: nobody stops at
    gate 1, unless the style says so. In three dimensions only x, y, z are planned and yaw stays
    at the heading of gate 1; in four, yaw follows the gates' headings; in six, roll
    and pitch are zero at each gate as well. By differential flatness (Mellinger
    and Kumar, ICRA 2011) these are zero where the horizontal acceleration is.

    Between midpoints alone, the shortest lap may slip through a gate sideways,
    along its pylons. Such a gate gets a waypoint straight in front of it.

    A lap that rests leads from beyond gate 1 to there: at both ends, all derivatives through
    the snap are zero. If need be, it gets a waypoint as far in front of gate 1.

    With soft limits, laps are as the original system had them. Those in four and six dimensions
    are stretched until they keep the limits; those in three may exceed them, but not what the
    rotors can fly. Roll and pitch had polynomials of their own, which were zero and did not
    bend the path: so laps in six dimensions are those in four. Gates may be passed at any angle
    from the front. All laps keep clear of pylons, which the original ones did not.

    Args:
        midpoints: of the gates, (n, 3) m.
        headings: of the gates, (n,) rad.
        dimensions: 3, 4 or 6.
        constraints: of finite speed and acceleration. The lap is slowed until the rotors of
            the vehicle can fly it.
        previous: the lap through a similar map, to start from; not with soft limits.
        style: see LapStyle.

    Raises:
        TrajectoryOptimizationError: if there is no such lap.
    """
    limits = constraints.limits
    constraints = dc.replace(constraints, limits=_kept(limits, dimensions, style))
    gates = _gates(midpoints, headings)
    if previous is not None and not style.soft and len(previous.headings) == len(gates):
        with contextlib.suppress(TrajectoryOptimizationError):
            durations = np.diff(previous.breaks)
            circuit = _solve(gates, previous.approach, dimensions, limits, style, durations)
            faults = _faults(circuit, constraints, style)
            if not faults and is_feasible(circuit, constraints):
                return circuit
    faults = set()
    for distance in _APPROACHES:
        # A waypoint in front of one gate may lead to another minimum, with faults elsewhere.
        for _ in range(_MOST_ROUNDS):
            approach = {} if distance is None else dict.fromkeys(sorted(faults), distance)
            if style.rests and approach:
                approach[0] = REST_BEYOND
            try:
                circuit = _solve(gates, approach, dimensions, limits, style)
            except TrajectoryOptimizationError:
                break
            new_faults = _faults(circuit, constraints, style)
            if not new_faults and is_feasible(circuit, constraints):
                return circuit
            settled = distance is None or new_faults <= faults
            # A lap that comes to rest from the side may have no other fault.
            faults |= {0} if style.rests and not faults else new_faults
            if settled:
                break
        if not faults:
            break  # there is nothing to try
    raise TrajectoryOptimizationError("No lap is within the limits and clear of all pylons.")


def circuit_problem(
    midpoints: ArrayLike,
    headings: ArrayLike,
    dimensions: int,
    *,
    approach: Mapping[int, float] | None = None,
    style: LapStyle = LapStyle(),
) -> MinSnapProblem:
    """Returns the minimum-snap problem of a lap, of which plan_circuit() solves the program.

    Args:
        midpoints, headings, dimensions, style: see plan_circuit().
        approach: gate index to distance (m) of a waypoint in front of it.
    """
    gates = _gates(midpoints, headings)
    waypoints, options, _ = _waypoints(gates, approach or {}, dimensions, style)
    return MinSnapProblem(waypoints, **options)


def _gates(midpoints: ArrayLike, headings: ArrayLike) -> np.ndarray:
    """Returns midpoints and headings side by side, (n, 4); checks them."""
    regions = GateRegions.balls(midpoints, headings, 0.0)
    return np.column_stack([regions.midpoints, regions.headings])


def _waypoints(
    gates: np.ndarray, approach: Mapping[int, float], dimensions: int, style: LapStyle
) -> tuple[np.ndarray, dict, list[int]]:
    """Returns waypoints and options of the MinSnapProblem of a lap, and which are its gates."""
    waypoints, indices = [], []
    legs = np.linalg.norm(gates[:, :3] - np.roll(gates[:, :3], 1, axis=0), axis=1)
    for i, (gate, leg) in enumerate(zip(gates, legs)):
        forward = np.array([np.cos(gate[3]), np.sin(gate[3]), 0.0, 0.0])
        if i in approach:
            waypoints.append(gate - min(approach[i], leg / 2) * forward)
        indices.append(len(waypoints))
        waypoints.append(gate + REST_BEYOND * forward if i == 0 and style.rests else gate)
    turn = np.array([0.0, 0.0, 0.0, turn_per_lap(gates[:, 3])])
    # The lap starts at gate 1, its approach comes last.
    if indices[0] > 0:
        waypoints = [*waypoints[1:], waypoints[0] + turn]
        indices = [i - 1 for i in indices]
    waypoints = np.array(waypoints)
    if dimensions == 3:
        waypoints[:, 3], turn = gates[0, 3], np.zeros(4)
    level = indices if dimensions == 6 and not style.soft else ()
    constraints = [DerivativeConstraint(i, 2, LEVEL) for i in level]
    if style.rests:
        constraints += [DerivativeConstraint(0, order, np.zeros(4)) for order in range(1, 5)]
    options = dict(constraints=constraints, periodic=True, period_offset=turn)
    return waypoints, options, indices


def _solve(
    gates: np.ndarray,
    approach: dict,
    dimensions: int,
    limits: FlightLimits,
    style: LapStyle,
    durations: np.ndarray | None = None,
) -> Circuit:
    """Returns the lap with some waypoints in front of gates, searched for from some durations."""
    waypoints, options, indices = _waypoints(gates, approach, dimensions, style)
    problem = MinSnapProblem(waypoints, **options)
    problem.require_unique()
    if style.soft:
        durations = allocate_times_softly(
            waypoints,
            max_speed=limits.max_speed,
            max_acceleration=limits.max_acceleration,
            share=None if dimensions == 3 else _MARGIN,
            **options,
        )
    else:
        durations = allocate_times(
            waypoints,
            initial_durations=durations,
            max_speed=_MARGIN * limits.max_speed,
            max_acceleration=_MARGIN * limits.max_acceleration,
            **options,
        )

    def lap(path):
        breaks = np.array(path.get_segment_times())
        times = np.append(breaks[indices], breaks[-1])
        if style.rests:
            times[[0, -1]] -= _since_gate(path, times[-2], gates[0])
        return Circuit(path, times, gates[:, 3], approach)

    factor = _least_factor(problem, durations, lap, _kept(limits, dimensions, style))
    return lap(problem.program(factor * durations).solve())


def _kept(limits: FlightLimits, dimensions: int, style: LapStyle) -> FlightLimits:
    """Returns the limits that laps keep: soft ones in three dimensions only what rotors can fly."""
    if style.soft and dimensions == 3:
        return dc.replace(limits, max_speed=np.inf, max_acceleration=np.inf)
    return limits


def _since_gate(path: PiecewisePolynomial, start: float, gate: np.ndarray) -> float:
    """Returns for how long a path has been beyond a gate when it ends (s).

    Args:
        path: of x, y, z and yaw.
        start: of its last leg (s).
        gate: its midpoint and heading, x, y, z and yaw, (4,).
    """
    forward = np.array([np.cos(gate[3]), np.sin(gate[3]), 0.0, 0.0])

    def ahead(time):
        return float(forward @ (path.value(time)[:, 0] - gate))

    end = path.end_time()
    times = np.linspace(start, end, _LEG_SAMPLES)
    behind = [k for k, time in enumerate(times) if ahead(time) < 0.0]
    if not behind:
        return 0.0  # at rest in the gate, it has not passed it forward
    from scipy.optimize import brentq  # here, as few races need it: it takes 0.3 s

    return end - brentq(ahead, times[behind[-1]], times[behind[-1] + 1])


def _least_factor(
    problem: MinSnapProblem,
    durations: np.ndarray,
    lap: Callable[[PiecewisePolynomial], Circuit],
    limits: FlightLimits,
) -> float:
    """Returns the least factor of the durations, 1 or more, with which the rotors can fly a lap."""
    limits = dc.replace(limits, thrust_share=_MARGIN * limits.thrust_share)

    def excess(factor):
        T = factor * durations
        circuit = lap(problem.trajectory(T, problem.solve_closed_form(T)))
        return check_flight(circuit.sample(sample_times(circuit)), (), limits).excess

    low = high = 1.0
    while excess(high) > 0.0:
        low, high = high, 1.1 * high
        if high > _MOST_SLOWING:
            raise TrajectoryOptimizationError("The rotors cannot fly the lap, however slow.")
    while high - low > 1e-4 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if excess(middle) > 0.0 else (low, middle)
    return high


def _faults(circuit: Circuit, constraints: FlightConstraints, style: LapStyle) -> set:
    """Returns the gates that are passed sideways or nearest to where a pylon is too near."""
    gate_times = np.array(circuit.gate_times)
    forward = passes_forward(
        circuit,
        gate_times[:-1] % circuit.duration,
        circuit.headings,
        within=np.pi / 2 if style.soft else MAX_CROSSING_ANGLE,
    )
    times = sample_times(circuit)
    distances = pylon_distances(circuit.sample(times), constraints.pylons)
    near = (distances < constraints.clearance).any(axis=1)
    nearest = np.abs(times[near, None] - gate_times).argmin(axis=1) % len(forward)
    return {*np.flatnonzero(~forward).tolist(), *nearest.tolist()}
