"""What a race leaves behind: race.json, built up as the race goes on."""

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np

from airrace.scenario import PLANNED, VIO, Scenario
from airrace.systems.planning.lap_plan import NO_PLAN, PlanSummary
from airrace.systems.referee import OUT_OF_TIME
from airrace.systems.types import ExplorerEvent, ExplorerStatus, PilotStatus, RefereeStatus
from airrace.track import Course
from airrace.track.gate_map import GateMap
from airrace.vehicle import load_vehicle

# Mean laps of the original system on one track, from rest to rest (s), by trajectory.
ORIGINAL_TRACK, ORIGINAL_LAPS = "student-airrace", {"3": 40.60, "4": 41.52, "6": 41.21}


def wall_data(simulation: str, simulated: float, seconds: float) -> dict:
    """Returns what race.json says, below ``wall``, of every race.

    Args:
        simulation: SITL, HITL or MAVLINK.
        simulated: time that was simulated (s).
        seconds: what that took (s).
    """
    return {
        "simulation": simulation,
        "seconds": seconds,
        "real_time_factor": simulated / max(seconds, 1e-9),
    }


class RaceResult:
    """Collects a race's results from its outputs while it goes on.

    Attributes:
        vehicle: the drone, as its file says.
        referee_status: the latest.
        explorer_status: the latest.
        events: ExplorerEvents, all so far.
        pilot_events: pairs of when a network took over or handed back (s), and what happened.
        rotor_losses: number of a rotor, from 1, to when its loss was noticed (s).
    """

    def __init__(self, scenario: Scenario, track: Course, simulation: str = "SITL"):
        """Args: scenario, track: of the race. simulation: SITL or HITL."""
        self._scenario, self._track, self._simulation = scenario, track, simulation
        self._time, self._plans, self._map_rms = 0.0, {}, {}
        self.vehicle = load_vehicle(scenario.drone)[0]
        self.referee_status = RefereeStatus((), False, None, None, 0)
        self.explorer_status, self.events = ExplorerStatus(), ()
        self.pilot_events: tuple[tuple[float, str], ...] = ()
        self.rotor_losses = {}

    @property
    def laps_flown(self) -> int:
        """Number of complete laps."""
        return max(len(self.referee_status.crossings) - 1, 0) // len(self._track.gates)

    def observe(self, outputs: SimpleNamespace) -> int:
        """Takes in what the race's outputs say now; returns how many laps have ended since.

        Args:
            outputs: a namespace of ``time`` (s) and of the values of the outputs at that
                time: ``referee_status``, ``explorer_status``, ``gate_map``, ``lap_plan``,
                ``rotor_losses``, see RotorMonitor, and ``gate_shifts``, see GateMover,
                None if the gates stand still; ``pilot_status``, if a LearnedPilot flies.
        """
        before = self.laps_flown
        self.pilot_events = _pilot_events(
            self.pilot_events, getattr(outputs, "pilot_status", PilotStatus())
        )
        self._time, self.referee_status = outputs.time, outputs.referee_status
        self.explorer_status = outputs.explorer_status
        self.events = _events(self.events, outputs.explorer_status)
        for i in np.flatnonzero(np.isfinite(outputs.rotor_losses)):
            self.rotor_losses[int(i) + 1] = float(outputs.rotor_losses[i])
        plan, shifts = outputs.lap_plan, outputs.gate_shifts
        if plan is not NO_PLAN:
            self._plans[plan.lap] = plan
        for lap in range(before + 1, self.laps_flown + 1):
            track = self._track if shifts is None else self._track.shifted(shifts)
            # What a drone that finds out itself where it is takes for the world moves with gate 1.
            floats = shifts is not None and self._scenario.estimator == VIO
            self._map_rms[lap] = front_marker_rms(outputs.gate_map, track, aligned=floats)
        return self.laps_flown - before

    def data(
        self,
        wall_seconds: float,
        dnf_reason: str | None = None,
        wall: Mapping[str, Any] | tuple = (),
    ) -> dict:
        """Returns race.json. All but ``wall`` follows from scenario and seed.

        Args:
            wall_seconds: what the race took.
            dnf_reason: why it ended if the referee did not end it.
            wall: what else belongs below ``wall``, a dict.
        """
        laps = [self._lap(k) for k in range(1, self.laps_flown + 1)]
        summaries = [self._plan_of(lap["lap"])[1] for lap in laps]
        times = [lap["time_s"] for lap in laps]
        referee, explorer = self.referee_status, self.explorer_status
        end = referee.end_time if referee.over else self._time  # is observed a little later
        return {
            "track": self._track.name,
            "drone": self.vehicle.name,
            "trajectory": self._scenario.trajectory,
            "limits": self._scenario.planner.limits,
            "seed": self._scenario.seed,
            "rotor_failures": [
                {"rotor": f.rotor, "time_s": f.time, "noticed_s": self.rotor_losses.get(f.rotor)}
                for f in self._scenario.rotor_failures
            ],
            "finished": referee.finished,
            "dnf_reason": None if referee.finished else self._dnf_reason(dnf_reason),
            "exploration": {
                "success": explorer.closed_at is not None,
                "time_s": end if explorer.closed_at is None else explorer.closed_at,
                "gates_found": len(explorer.gates),
                "events": [
                    {"time_s": e.time, "state": e.state, "reason": e.reason} for e in self.events
                ],
            },
            **self._pilot_data(),
            "laps": laps,
            "mean_lap_s": float(np.mean(times)) if times else None,
            "best_lap_s": min(times, default=None),
            "collisions": referee.collisions,
            "wall": {
                **wall_data(self._simulation, self._time, wall_seconds),
                "plan_solve_times_s": [each and each.solve_time for each in summaries],
                **dict(wall),
            },
        }

    def _pilot_data(self) -> dict:
        """Returns what race.json says of a pilot that is not the planner."""
        if self._scenario.pilot == PLANNED:
            return {}
        events = [{"time_s": time, "what": what} for time, what in self.pilot_events]
        return {"pilot": {"name": self._scenario.pilot, "events": events}}

    def _dnf_reason(self, other: str | None) -> str | None:
        """Returns why the race ended; for a search in vain, in which state, or for what."""
        reason, explorer = self.referee_status.dnf_reason or other, self.explorer_status
        if reason != OUT_OF_TIME:
            return reason
        if not explorer.done:
            return f"{reason} in state {explorer.state}: {explorer.reason}"
        return reason if self._plans else f"{reason}: no lap through the map's gates was found"

    def _lap(self, lap: int) -> dict:
        n = len(self._track.gates)
        crossings = self.referee_status.crossings[n * (lap - 1) : n * lap + 1]
        start, (number, summary) = crossings[0].time, self._plan_of(lap)
        return {
            "lap": lap,
            "start_s": start,
            "time_s": crossings[-1].time - start,
            "gate_times_s": [c.time - start for c in crossings[:-1]],
            "gate_offsets_m": [c.offset for c in crossings[:-1]],
            "max_speed": max(c.max_speed for c in crossings[1:]),
            "map_rms_m": self._map_rms[lap],
            "plan": summary and {"number": number, **plan_data(summary)},
        }

    def _plan_of(self, lap: int) -> tuple[int, PlanSummary | None]:
        """Returns the number of the plan that a lap flew, from 1, and what it promised."""
        plans = [plan for first, plan in sorted(self._plans.items()) if first <= lap]
        return len(plans), plans[-1].summary if plans else None


# What race.json calls the parts of a PlanSummary that it holds.
_PLAN = {
    "duration_s": "duration",
    "bound_s": "bound",
    "over_bound": "gap",
    "max_speed": "max_speed",
    "max_acceleration": "max_acceleration",
    "max_rate": "max_rate",
    "max_rotor_thrust": "max_rotor_thrust",
    "max_rotor_thrusts": "max_thrusts",
    "min_rotor_thrusts": "min_thrusts",
    "limits_reached": "active_limits",
    "pylon_clearance_m": "clearance",
    "margin_m": "margin",
    "solver": "solver",
    "iterations": "iterations",
    "warm": "warm",
}


def plan_data(summary: PlanSummary) -> dict:
    """Returns what race.json says of a plan: see PlanSummary for what it is."""
    values = {name: getattr(summary, attribute) for name, attribute in _PLAN.items()}
    return {name: list(v) if isinstance(v, tuple) else v for name, v in values.items()}


def _events(events: tuple, status: ExplorerStatus) -> tuple:
    """Returns all events after an observation; an explorer of one's own may keep none."""
    if status.events:
        return status.events
    if events and (events[-1].state, events[-1].time) == (status.state, status.since):
        return events
    return (*events, ExplorerEvent(status.since, status.state, status.reason))


def _pilot_events(
    events: tuple[tuple[float, str], ...], status: PilotStatus
) -> tuple[tuple[float, str], ...]:
    """Returns when a LearnedPilot took over and handed back (s), and in words, so far."""
    if status.flies and not events:
        return ((status.since, "the network flies"),)
    if status.reason and not (events and events[-1][1].endswith(status.reason)):
        return (*events, (status.since, f"the planner flies: {status.reason}"))
    return events


def front_marker_rms(gate_map: GateMap, track: Course, aligned: bool = False) -> float | None:
    """Returns the RMS position error of the front markers in the map (m).

    Args:
        gate_map: the map.
        track: the truth.
        aligned: whether the map is laid over the truth first, by a shift and a turn on the ground.

    Returns:
        None if the map has none of them.
    """
    truth = {board.id: board.X_WM.translation() for board in track.boards()}
    pairs = [
        (marker.p_WM, truth[marker.id])
        for marker in gate_map.markers
        if marker.id % 2 == 0 and marker.id in truth
    ]
    if not pairs:
        return None
    found, true = np.array(pairs).swapaxes(0, 1)
    if aligned:
        found = _laid_over(found, true)
    errors = [np.linalg.norm(off) for off in found - true]
    return float(np.sqrt(np.mean(np.square(errors))))


def _laid_over(points: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Returns points, (n, 3), after the shift and the turn on the ground that fit others best.

    In the plane of complex numbers the best turn is the phase of the sum of conj(a) b, of points a
    and others b about their means.
    """
    a, b = (each[:, 0] + 1j * each[:, 1] for each in (points, others))
    turn = np.exp(1j * np.angle(np.sum(np.conj(a - a.mean()) * (b - b.mean()))))
    moved = turn * (a - a.mean()) + b.mean()
    return np.column_stack([moved.real, moved.imag, points[:, 2]])
