"""The value that crosses the lap_plan port."""

import dataclasses as dc
from typing import SupportsIndex

import numpy as np

from airrace.common.immutable import Immutable
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.min_snap.circuit import Circuit


@dc.dataclass(frozen=True, eq=False)
class PlanSummary(Immutable):
    """What a lap plan asks of the vehicle, from inverse dynamics at 1 kHz of entry and lap."""

    solve_time: float = 0.0  #: wall time of the solve (s)
    duration: float = 0.0  #: of the lap, gate 1 to gate 1 (s)
    max_speed: float = 0.0  #: m/s
    max_acceleration: float = 0.0  #: without gravity (m/s^2)
    max_rotor_thrust: float = 0.0  #: of any rotor (N)
    #: max_thrusts, min_thrusts: of every rotor (N), tuples
    max_thrusts: tuple = ()
    min_thrusts: tuple = ()
    max_rate: float | None = None  #: of the body's angular velocity (rad/s)
    clearance: float | None = None  #: from the nearest pylon's axis (m)
    #: Between drone and boards that was asked for, at the gate where it is the most (m).
    margin: float | None = None
    active_limits: tuple = ()  #: names of the limits that are used to the full
    #: The lap of a point mass with the same limits through the same gates, and as far from the
    #: pylons (s).
    bound: float | None = None
    solver: str = ""  #: its name
    iterations: int | None = None  #: of convex programs, or None
    warm: bool = False  #: whether the search started from the lap before
    #: What the plan counts with, of the drone: each rotor's thrust by the drone's mass, of what its
    #: file says, (n,); and of the air, see Air: drag along any axis, linear (1/s) and quadratic
    #: (1/m), and the wind (m/s, in the world), (3,). Tuples.
    rotor_factors: tuple = ()
    drag: tuple = ()
    wind: tuple = ()

    @property
    def gap(self) -> float | None:
        """How much longer than the bound, as a share of it."""
        return self.duration / self.bound - 1.0 if self.bound else None


@dc.dataclass(frozen=True, eq=False)
class LapPlan(Immutable):
    """A trajectory that joins a lap and then repeats it until it is replaced."""

    lap: int  #: number of the first lap flown on this plan, from 1
    start_time: float  #: when the entry starts (s)
    entry: FlatTrajectory  #: from the state at the hand-over onto the circuit
    circuit: Circuit  #: one lap, gate 1 to gate 1
    phase: float  #: time on the circuit at which the entry joins it (s)
    summary: PlanSummary  #: what the plan asks of the vehicle

    def derivatives(self, time: float) -> np.ndarray:
        """Returns value and four derivatives of x, y, z, yaw at a time, (5, 4)."""
        flight, t = self._flown_at(time)
        return flight.derivatives(t)

    def reference(self, time: float) -> np.ndarray:
        """Returns the same as a sample of trajopt/reference.py, (18,)."""
        flight, t = self._flown_at(time)
        return flight.reference(t)

    def _flown_at(self, time: float) -> tuple[FlatTrajectory, float]:
        """Returns entry or circuit, and the time on it."""
        t = time - self.start_time
        if t < self.entry.duration:
            return self.entry, t
        t += self.phase - self.entry.duration
        return self.circuit, t % self.circuit.duration

    def lap_at(self, time: float) -> int:
        """Returns the number of the lap being flown at a time; gate 1, or rest there, starts it.

        On an entry before gate 1 that is the lap before the plan's first.
        """
        flown = (time - self._first_start) / self.circuit.duration
        return self.lap + int(max(np.floor(flown), -1.0))

    def next_start(self, time: float) -> float:
        """Returns when the drone next passes gate 1, or rests there, after a time (s)."""
        laps = self.lap_at(time) + 1 - self.lap
        return self._first_start + laps * self.circuit.duration

    def nearest_gate(self, time: float) -> int:
        """Returns the number of the gate, from 0 for gate 1, that is nearest in time."""
        on_lap = (time - self._first_start) % self.circuit.duration
        times = np.asarray(self.circuit.gate_times)
        return int(np.argmin(np.abs(times - on_lap))) % (len(times) - 1)

    @property
    def _first_start(self) -> float:
        """When the circuit, traced back from the entry's end, starts (s)."""
        return self.start_time + self.entry.duration - self.phase

    def __reduce_ex__(self, protocol: SupportsIndex) -> str | tuple:
        # So that a pickled NO_PLAN is the same object again.
        return "NO_PLAN" if self.lap == 0 else super().__reduce_ex__(protocol)


_REST = FlatTrajectory.resting(np.zeros(4))
# What the lap_plan port holds until the race begins; compare with `is`.
NO_PLAN = LapPlan(
    lap=0,
    start_time=0.0,
    entry=_REST,
    circuit=Circuit(_REST.polynomial, (0.0, _REST.duration), np.zeros(1), {}),
    phase=0.0,
    summary=PlanSummary(),
)
