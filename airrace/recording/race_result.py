"""What a race leaves behind: race.json, built up as the race goes on."""

import numpy as np

from airrace.scenario import Scenario
from airrace.systems.planning.lap_plan import NO_PLAN, LapPlan, PlanSummary
from airrace.systems.referee_status import OUT_OF_TIME, RefereeStatus
from airrace.systems.types import ExplorerEvent, ExplorerStatus
from airrace.track import Track
from airrace.track.gate_map import GateMap
from airrace.vehicle import load_vehicle


class RaceResult:
    """Collects a race's results from looks at its outputs."""

    def __init__(self, scenario: Scenario, track: Track, simulation: str = "SITL"):
        """Args: scenario, track: of the race. simulation: SITL or HITL."""
        self._scenario = scenario
        self._track = track
        self.vehicle = load_vehicle(scenario.drone)[0]
        self.rotor_losses = {}  # number of a rotor, from 1, to when it was noticed (s)
        self._simulation = simulation
        self._plans = {}
        self._map_rms = {}
        self._time = 0.0
        self._status = ExplorerStatus()
        self.events = ()  # ExplorerEvents, all so far
        self.report = RefereeStatus((), False, None, None, 0)

    @property
    def laps_flown(self) -> int:
        """Number of complete laps."""
        return max(len(self.report.crossings) - 1, 0) // len(self._track.gates)

    @property
    def status(self) -> ExplorerStatus:
        """The explorer's latest status."""
        return self._status

    def observe(
        self,
        time,
        report: RefereeStatus,
        status: ExplorerStatus,
        gate_map: GateMap,
        plan: LapPlan,
        rotor_losses=(),
        gate_shifts=None,
    ) -> int:
        """Takes a look at the race; returns how many laps ended since the last.

        Args:
            time: of the look (s).
            report, status, gate_map, plan, rotor_losses: the outputs at that
                time; for the last, see RotorMonitor.
            gate_shifts: where the gates stand then, see GateMover; None if they
                do not move.
        """
        before = self.laps_flown
        self._time, self.report, self._status = time, report, status
        self.events = _events(self.events, status)
        for i in np.flatnonzero(np.isfinite(rotor_losses)):
            self.rotor_losses[int(i) + 1] = float(rotor_losses[i])
        if plan is not NO_PLAN:
            self._plans[plan.lap] = plan
        for lap in range(before + 1, self.laps_flown + 1):
            track = self._track if gate_shifts is None else self._track.shifted(gate_shifts)
            self._map_rms[lap] = front_marker_rms(gate_map, track)
        return self.laps_flown - before

    def data(self, wall_seconds: float, dnf_reason: str | None = None, wall=()) -> dict:
        """Returns race.json. All but ``wall`` follows from scenario and seed.

        Args:
            wall_seconds: what the race took.
            dnf_reason: why it ended if the referee did not end it.
            wall: what else belongs below ``wall``, a dict.
        """
        laps = [self._lap(k) for k in range(1, self.laps_flown + 1)]
        times = [lap["time_s"] for lap in laps]
        status = self._status
        # Looks come a little after the end.
        time = self.report.end_time if self.report.over else self._time
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
            "finished": self.report.finished,
            "dnf_reason": None if self.report.finished else self._dnf_reason(dnf_reason),
            "exploration": {
                "success": status.closed_at is not None,
                "time_s": status.closed_at if status.closed_at is not None else time,
                "gates_found": len(status.gates),
                "events": [
                    {"time_s": e.time, "state": e.state, "reason": e.reason} for e in self.events
                ],
            },
            "laps": laps,
            "mean_lap_s": float(np.mean(times)) if times else None,
            "best_lap_s": min(times, default=None),
            "collisions": self.report.collisions,
            "wall": {
                "simulation": self._simulation,
                "seconds": wall_seconds,
                "real_time_factor": self._time / max(wall_seconds, 1e-9),
                "plan_solve_times_s": [self._solve_time(lap["lap"]) for lap in laps],
                **dict(wall),
            },
        }

    def _dnf_reason(self, other: str | None) -> str | None:
        """Returns why the race ended; for a search in vain, in which state, or for what."""
        reason, status = self.report.dnf_reason or other, self._status
        if reason != OUT_OF_TIME:
            return reason
        if not status.done:
            return f"{reason} in state {status.state}: {status.reason}"
        return reason if self._plans else f"{reason}: no lap through the map's gates was found"

    def _lap(self, lap: int) -> dict:
        n = len(self._track.gates)
        crossings = self.report.crossings[n * (lap - 1) : n * lap + 1]
        start = crossings[0].time
        report = self._plan_summary(lap)
        return {
            "lap": lap,
            "start_s": start,
            "time_s": crossings[-1].time - start,
            "gate_times_s": [c.time - start for c in crossings[:-1]],
            "gate_offsets_m": [c.offset for c in crossings[:-1]],
            "max_speed": max(c.max_speed for c in crossings[1:]),
            "map_rms_m": self._map_rms[lap],
            "plan": report and plan_data(report),
        }

    def _plan_summary(self, lap: int):
        """Returns the PlanSummary of a lap's plan, or None."""
        plans = [plan for first, plan in sorted(self._plans.items()) if first <= lap]
        return plans[-1].report if plans else None

    def _solve_time(self, lap: int) -> float | None:
        """Returns what finding a lap's plan took (s)."""
        report = self._plan_summary(lap)
        return report and report.solve_time


def plan_data(report: PlanSummary) -> dict:
    """Returns what race.json says of a plan: see PlanSummary for what it is."""
    return {
        "duration_s": report.duration,
        "bound_s": report.bound,
        "over_bound": report.gap,
        "max_speed": report.max_speed,
        "max_acceleration": report.max_acceleration,
        "max_rate": report.max_rate,
        "max_rotor_thrust": report.max_rotor_thrust,
        "max_rotor_thrusts": list(report.max_thrusts),
        "min_rotor_thrusts": list(report.min_thrusts),
        "limits_reached": list(report.reached),
        "pylon_clearance_m": report.clearance,
        "margin_m": report.margin,
        "solver": report.solver,
        "iterations": report.iterations,
        "warm": report.warm,
    }


def _events(events: tuple, status: ExplorerStatus) -> tuple:
    """Returns the events after a look; an explorer of one's own may keep none."""
    if status.events:
        return status.events
    if events and (events[-1].state, events[-1].time) == (status.state, status.since):
        return events
    return (*events, ExplorerEvent(status.since, status.state, status.reason))


def front_marker_rms(gate_map: GateMap, track: Track) -> float | None:
    """Returns the RMS position error of the front markers in the map (m).

    Args:
        gate_map: the map.
        track: the truth.

    Returns:
        None if the map has none of them.
    """
    truth = {board.id: board.X_WM.translation() for board in track.boards()}
    errors = [
        np.linalg.norm(marker.p_WM - truth[marker.id])
        for marker in gate_map.markers
        if marker.id % 2 == 0 and marker.id in truth
    ]
    return float(np.sqrt(np.mean(np.square(errors)))) if errors else None
