"""Time-optimal flights of open courses: from rest, through gates, to rest."""

import contextlib
import dataclasses as dc
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from airrace.common.immutable import Immutable
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.flatness import thrust_vectors
from airrace.trajopt.flight_limits import FlightConstraints, FlightLimits
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.reference import as_reference
from airrace.trajopt.time_optimal.dynamics import angle_dynamics
from airrace.trajopt.time_optimal.lap_samples import Grid, LapSamples, slowed
from airrace.trajopt.time_optimal.lap_search import Effort, LapSearch
from airrace.trajopt.time_optimal.lap_spline import LapSpline
from airrace.trajopt.time_optimal.optimal_lap import PRECISION, first_lap, refined_lap
from airrace.trajopt.time_optimal.path_terms import crossings
from airrace.trajopt.time_optimal.point_mass import point_mass_bound
from airrace.vehicle.vehicle import checked_vehicle

# Pieces of each leg's spline, and when the search with so many ends: one after the other.
STAGES = ((8, Effort(60, 1e-3, samples=32)), (12, Effort(20, 1e-3, samples=80)))
_FIRMNESS = 100.0  # of the search: courses may have short legs among long ones
# Of the search within tighter limits, for what lies between its samples.
_ROUNDS, _LAST = 6, Effort(1, 5e-4, caution=100.0)
_BEYOND, _MORE = 1.2, 5e-4  # times what is exceeded, and that much more
_NEARLY = np.deg2rad(0.5)  # of a heading
_RATE, _CHECK = 1000.0, 2000.0  # Hz, of states, and of the last check


class CourseStates(NamedTuple):
    """The whole state of a drone on a course, at N times."""

    times: np.ndarray  #: since the start (s), (N,)
    positions: np.ndarray  #: p_WB (m), (3, N)
    velocities: np.ndarray  #: v_WB (m/s), (3, N)
    rotations: np.ndarray  #: R_WB, (3, 3, N)
    angular_velocities: np.ndarray  #: w_WB in B (rad/s), (3, N)
    thrusts: np.ndarray  #: of the rotors (N), (rotors, N)


@dc.dataclass(frozen=True, eq=False)
class CourseFlight(Immutable):
    """A flight of an open course."""

    spline: LapSpline  #: its path and its thrust-axis angle
    limits: FlightLimits  #: that it keeps
    bound: float  #: what a point mass takes (s)
    iterations: int  #: of convex programs

    @property
    def duration(self) -> float:
        """From the start to the goal (s)."""
        return self.spline.duration

    @property
    def gate_times(self) -> np.ndarray:
        """When the start, the gates and the goal are passed (s)."""
        return np.cumsum([0.0, *self.spline.durations])

    def states(self, count: int | None = None) -> CourseStates:
        """Returns the states evenly in time over each leg, and at the goal.

        Unlike a FlatTrajectory, they are those of a drone that may fly upside down.

        Args: count: of each leg; by default so many that there are 1000 a second, or more.
        """
        fine = _fine(self.spline, count or 1)
        samples = LapSamples.of(self.spline, fine, self.limits, 0.0)
        steps = fine.samples - 1
        # Every gate once.
        each = np.arange(len(samples.units)).reshape(-1, steps + 1)
        at = np.append(each[:, : -1 : steps // count if count else 1], each[-1, -1])
        flat, units, r = samples.flat[:, at], samples.units[at], as_reference(samples.flat[:, at])
        axes = [axis[:, at] for axis in samples.axes]
        thrusts, force, w, _ = angle_dynamics(flat, units, axes, self.limits)
        z = force / np.linalg.norm(force, axis=0)
        x = np.cos(r.yaw) * axes[0] + np.sin(r.yaw) * axes[1]
        x = x - np.sum(x * z, axis=0) * z
        x = x / np.linalg.norm(x, axis=0)
        return CourseStates(
            self.spline.sample_times(fine.fractions).ravel()[at],
            r.position,
            r.velocity / units,
            np.stack([x, np.cross(z, x, axis=0), z], axis=1),
            w / units,
            thrusts / units**2,
        )


@np.errstate(divide="ignore", invalid="ignore")  # see LapSamples.excess()
def plan_optimal_course(
    gates: GateRegions, constraints: FlightConstraints, stages: Sequence = STAGES
) -> CourseFlight:
    """Returns the quickest flight found from a start at rest through gates to rest at a goal.

    The search is that of plan_optimal_circuit(). The drone may tilt beyond 90 degrees if
    limits.min_lift is -inf, and need not see the next gate if constraints.half_view is pi.
    It starts with its x axis along x, and ends with any heading. At both ends it has no velocity
    and no angular velocity, but may have any thrust. Planning takes some ten seconds.

    Args:
        gates: made with their argument ``between``, the places of start and goal. Where
            a flight has to turn back for a gate's heading, and is not to stop in the gate, there
            are to be balls before and behind it, too.
        constraints: to keep, with ``min_height`` below start and goal; that and the clearance
            from pylons may be 5 cm less.
        stages: of the search, see STAGES.

    Raises:
        TrajectoryOptimizationError: if there is no such flight, or none was found.
        UserError: if the limits are of a vehicle that cannot be, see Vehicle.check().
    """
    limits = constraints.limits
    checked_vehicle(limits.vehicle, limits.vehicle.name)
    constraints.check()
    if gates.is_closed:
        raise TrajectoryOptimizationError("A course is open: name its start and its goal.")
    if gates.midpoints[list(gates.ends), 2].min() < constraints.min_height:
        raise TrajectoryOptimizationError(
            f"The start or the goal is below {constraints.min_height} m, the least height."
        )
    bound = point_mass_bound(gates, constraints, **PRECISION)  # type: ignore[arg-type]
    searches = [
        LapSearch(gates, 0.0, constraints, Grid(pieces, effort.samples, to_end=True), _FIRMNESS)
        for pieces, effort in stages
    ]
    lap = first_lap(bound, searches[0]).lap
    lap, iterations = dc.replace(lap, chart=_clear_chart(searches[0].settled(lap))), 0
    for search, (pieces, effort) in zip(searches, stages):
        now = search.settled(refined_lap(lap, pieces))
        now, more = search.improve(now, bool(iterations), effort)
        lap, iterations = now.lap, iterations + more
    best, more = _kept(now.lap, search)
    search.require_clear(best)
    _require_forward(best.lap, gates)
    return CourseFlight(best.lap, limits, bound.duration, iterations + more)


def _require_forward(lap: LapSpline, gates: GateRegions) -> None:
    """Raises TrajectoryOptimizationError if a gate is not crossed as its heading says."""
    speeds, along = crossings(lap, gates)
    off = np.arccos(np.clip(along / np.maximum(speeds, 1e-12), -1.0, 1.0))
    for i in np.flatnonzero(off > gates.most_off + _NEARLY):
        raise TrajectoryOptimizationError(
            f"The flight found crosses gate {i + 1} by {np.rad2deg(off[i]):.0f} degrees off its "
            f"heading, and may by {np.rad2deg(gates.most_off):.0f}. Name a ball before the gate "
            "and one behind it, too."
        )


def _kept(lap: LapSpline, search: LapSearch) -> tuple[LapSamples, int]:
    """Returns the quickest flight near one that keeps the limits at _CHECK, and iterations.

    What exceeds them between samples of the search is searched for anew within tighter ones.
    Slowing would be no cure: where the thrust nearly vanishes, a slower flight turns quicker, and
    to be rid of a thousandth of the rate may take a tenth of the time. It is the last resort.
    """
    constraints, iterations, laps = search.constraints, 0, [lap]
    limits = constraints.limits
    while len(laps) <= _ROUNDS:
        fine = LapSamples.of(lap, _fine(lap, rate=_CHECK), limits, 0.0)
        if fine.excess() <= 0.0:
            laps = [lap]
            break
        excesses = fine.excesses().items()
        missed = {name: _BEYOND * each + _MORE if each > 0.0 else 0.0 for name, each in excesses}
        aimed = search.constraints.limits.tightened(missed)
        search.constraints = dc.replace(constraints, limits=aimed)
        now, more = search.improve(LapSamples.of(lap, search.grid, aimed, 0.0), True, _LAST)
        lap, iterations = now.lap, iterations + more
        laps.append(lap)
    slower = []
    for each in laps:
        with contextlib.suppress(TrajectoryOptimizationError):
            slower.append(slowed(each, _fine(each, rate=_CHECK), limits, 0.0))
    if not slower:
        raise TrajectoryOptimizationError("No flight of this course keeps its limits.")
    return min(slower, key=lambda each: each.lap.duration), iterations


def _fine(lap: LapSpline, count: int = 1, rate: float = _RATE) -> Grid:
    """Returns a grid of a rate (Hz), or more, whose legs have a multiple of so many steps."""
    steps = count * int(np.ceil(rate * lap.durations.max() / count))
    return Grid(lap.pieces, steps + 1, to_end=True)


def _clear_chart(samples: LapSamples) -> np.ndarray:
    """Returns a LapSpline's chart with which the thrust's axis keeps far from the pole."""
    force, *_ = thrust_vectors(samples.flat, samples.units, samples.limits.air)
    b = force / np.linalg.norm(force, axis=0)
    angles = np.arange(16) * np.pi / 8
    level = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(16)])
    poles = [[0.0, 0.0, 1.0], *level, *(level + [0.0, 0.0, 1.0]) / np.sqrt(2.0)]
    pole = max(poles, key=lambda pole: np.min(np.asarray(pole) @ b))
    return _to_vertical(np.asarray(pole))


def _to_vertical(pole: np.ndarray) -> np.ndarray:
    """Returns the least rotation from a unit vector, (3,), to the vertical, (3, 3)."""
    x, y, z = pole
    k = 1.0 / (1.0 + z)
    return np.array(
        [[1.0 - k * x * x, -k * x * y, -x], [-k * x * y, 1.0 - k * y * y, -y], [x, y, z]]
    )
