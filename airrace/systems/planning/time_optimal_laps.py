"""Time-optimal laps of a planning problem."""

import contextlib
import dataclasses as dc

import numpy as np

from airrace.systems.planning.laps import Laps
from airrace.systems.planning.min_snap_laps import MinSnapLaps
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.feasibility import pylon_distances
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.min_snap.circuit import Circuit
from airrace.trajopt.time_optimal.optimal_lap import plan_optimal_circuit
from airrace.trajopt.time_optimal.optimal_transition import plan_optimal_transition

# Of the limits, of acceleration and of speed: the transition onto the lap has a little more than
# the lap.
_SHARE, _ACCELERATION_SHARE, _SPEED_SHARE = 0.99, 0.998, 0.9998
_HALF_HEIGHT = 2.5  # m, above and below a gate's midpoint
# Gates at which a transition joins the lap, tried in turn: from hover, and from the lap before.
_FROM_HOVER, _BETWEEN_LAPS = (3, 2, 4, 6), (2, 3, 1)
# s, lost on a transition without a loop, beside the guessed time to gate 1 and the lap's on.
_MAX_LOST = 2.0
_SAMPLES = 50  # of the rest of the old lap, and of its part that a transition begins with
# s, for which a transition may follow an old plan that asks too much of the rotors, tried in turn;
# and how much more than that plan it may ask.
_EASINGS, _ROOM = (0.02, 0.1, 0.3), 1.01


class TimeOptimalLaps(Laps):
    """Finds laps anywhere through the gates, see plan_optimal_circuit()."""

    solver = "Clarabel"

    def _gate_regions(self) -> GateRegions:
        gates = self._problem.gates
        # Of a gate's two pylons the one that is known less says how near to come.
        each = self.constraints.clearance[: 2 * len(gates)].reshape(-1, 2).max(axis=1)  # type: ignore[index]
        return GateRegions.windows(
            [g.p_WG for g in gates],
            [g.heading for g in gates],
            [g.spacing / 2 - clearance for g, clearance in zip(gates, each)],
            _HALF_HEIGHT,
        )

    def lap(self, previous: Circuit | None) -> Circuit:
        limits = self.constraints.limits
        limits = dc.replace(
            limits.scaled(_SHARE),
            max_speed=_SPEED_SHARE * limits.max_speed,
            max_acceleration=_ACCELERATION_SHARE * limits.max_acceleration,
        )
        return plan_optimal_circuit(
            self.gates,
            dc.replace(self.constraints, limits=limits),
            previous=previous,  # type: ignore[arg-type]
            bound=self.point_mass_lap,
        )

    def transition(
        self, circuit: Circuit, start: np.ndarray, remaining: float | None
    ) -> tuple[FlatTrajectory, float]:
        limits = self.constraints.limits
        shares = [limits.thrust_share]
        if remaining is None:
            joins, constraints, old = _FROM_HOVER, self.constraints, None
            gate = circuit.derivatives(0.0)
            first = 2.0 * np.linalg.norm(gate[0, :3] - start[0, :3]) / np.linalg.norm(gate[1, :3])
        else:
            joins, first, old = _BETWEEN_LAPS, remaining, self._old
            # It may start where the old plan comes nearer than is asked of a new one, or asks more
            # of rotors that have turned out weaker.
            clearance = np.minimum(self.constraints.clearance, self._old_distances(remaining))
            constraints = dc.replace(self.constraints, clearance=clearance)
            asked = [_ROOM * self._problem.old_share(time) for time in _EASINGS]
            shares = np.unique(np.maximum(limits.thrust_share, asked))
        joins = [k for k in joins if k < len(circuit.headings)]
        # Where the new lap is far from the old one, that is no guess.
        guesses = [(k, guess) for guess in ((old, None) if old else (None,)) for k in joins]
        for share in shares:
            constraints = dc.replace(constraints, limits=dc.replace(limits, thrust_share=share))
            found = []  # with what is lost on them (s)
            for k, guess in guesses:
                durations = [first, *np.diff(circuit.gate_times)[: k - 1]]
                with contextlib.suppress(TrajectoryOptimizationError):
                    transition, phase = plan_optimal_transition(
                        start,
                        durations,
                        self.gates,
                        circuit,  # type: ignore[arg-type]
                        constraints,
                        old=guess,
                    )
                    found.append((transition.duration - phase - first, transition, phase))
                    # A search may end with a loop before a gate: nothing near it is quicker.
                    if found[-1][0] <= _MAX_LOST:
                        break
            if found:
                return min(found, key=lambda each: each[0])[1:]
        # From odd places, or at the last moment.
        return MinSnapLaps(self._problem, 4).transition(circuit, start, remaining)

    def _old(self, time: float) -> np.ndarray:
        """Returns where the old plan leads to after a time, as in LapPlan.derivatives()."""
        return self._problem.old.derivatives(self._problem.start_time + time)

    def _old_distances(self, remaining: float) -> np.ndarray:
        """Returns how near the old plan comes to each pylon before gate 1, (m,) m."""
        places = [self._old(t)[0, :3] for t in np.linspace(0.0, remaining, _SAMPLES)]
        return pylon_distances(np.transpose(places), self.constraints.pylons).min(axis=0)
