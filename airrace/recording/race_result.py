"""What a race leaves behind: race.json, built up as the race goes on."""

import datetime
from collections.abc import Mapping
from typing import Any

import numpy as np

from airrace.common.version import VERSION
from airrace.recording import race_events as events
from airrace.scenario import NO_POLICY, Scenario
from airrace.systems.planning.lap_plan import LapPlan, PlanSummary
from airrace.systems.referee import OUT_OF_TIME
from airrace.systems.types import ExplorerEvent, ExplorerStatus, GateCrossing, RefereeStatus
from airrace.track import Course
from airrace.track.gate_map import GateMap
from airrace.vehicle import load_vehicle

# Mean laps of the original system on one track, from rest to rest (s), by trajectory.
ORIGINAL_TRACK, ORIGINAL_LAPS = "student-airrace", {"3": 40.60, "4": 41.52, "6": 41.21}

NOT_OVER = RefereeStatus((), False, None, None, 0)


def wall_data(simulation: str, simulated: float, seconds: float) -> dict:
    """Returns what race.json says, below ``wall``, of every race.

    Args:
        simulation: SITL, HITL or MAVLINK.
        simulated: time that was simulated (s).
        seconds: what that took (s).
    """
    return {
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "version": VERSION,
        "simulation": simulation,
        "seconds": seconds,
        "real_time_factor": simulated / max(seconds, 1e-9),
    }


def own_systems_words(systems: Mapping[str, str]) -> str:
    """Returns which systems are not airrace's own, for people; systems: as in a scenario."""
    return ", ".join(f"{name} is {path}" for name, path in systems.items())


class RaceResult:
    """A sink that collects a race's results while it goes on."""

    def __init__(self, scenario: Scenario, track: Course, simulation: str = "SITL"):
        """Args: scenario, track: of the race. simulation: SITL or HITL."""
        self._scenario, self._track, self._simulation = scenario, track, simulation
        self._drone = load_vehicle(scenario.drone)[0].name
        self._time, self._map = 0.0, GateMap()
        self._moved: Course | None = None  # where the gates are, if they move
        self._crossings = list[GateCrossing]()
        self._over: RefereeStatus | None = None
        self._explorer, self._entered = ExplorerStatus(), list[ExplorerEvent]()
        self._policy_events = list[dict]()
        self._plans = dict[int, LapPlan]()  # by the first lap flown on it
        self._map_rms = dict[int, float | None]()  # by lap (m)
        self._delay, self._delays = 0.0, [0.0]  # of plans: now, and at the start of each lap (s)
        self._negative_thrusts = 0
        self._losses = dict[int, float]()  # number of a rotor, from 1, to when it was noticed (s)

    @property
    def over(self) -> bool:
        """Whether the race has ended."""
        return self._over is not None

    @property
    def laps_flown(self) -> int:
        """Number of complete laps."""
        return max(len(self._crossings) - 1, 0) // len(self._track.gates)

    def take(self, event: events.RaceEvent) -> None:
        """Takes in what has happened."""
        self._time = event.time
        match event:
            case events.GatesMoved():
                self._moved = self._track.shifted(event.shifts)
            case events.MapChanged():
                self._map = event.gate_map
            case events.PlanMade():
                self._plans[event.plan.lap] = event.plan
            case events.ClockWaits():
                self._delay = event.delay
            case events.ExplorerChanged():
                self._explorer = event.status
                self._entered += event.entered
            case events.PolicyChanged():
                self._policy_events.append({"time_s": event.status.since, "what": event.what})
            case events.NegativeThrusts():
                self._negative_thrusts = event.number
            case events.RotorLost():
                self._losses[event.rotor] = event.noticed
            case events.RaceOver():
                self._over = event.status
            case events.GateCrossed():
                laps_before = self.laps_flown
                self._crossings.append(event.crossing)
                if event.crossing.gate == 1:
                    self._delays[self.laps_flown :] = [self._delay]
                if self.laps_flown > laps_before:
                    self._map_rms[self.laps_flown] = self._map_error()

    def _map_error(self) -> float | None:
        if self._moved is None:
            return front_marker_rms(self._map, self._track)
        # What a drone that finds out itself where it is takes for the world moves with gate 1.
        return front_marker_rms(self._map, self._moved, aligned=self._scenario.localizes)

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
        over, explorer = self._over or NOT_OVER, self._explorer
        reason = self._dnf_reason(over.dnf_reason or dnf_reason)
        end = self._time if over.end_time is None else over.end_time  # is seen a little later
        return {
            "track": self._track.name,
            "drone": self._drone,
            "trajectory": self._scenario.trajectory,
            "limits": self._scenario.planner.limits,
            "seed": self._scenario.seed,
            "rotor_failures": [
                {"rotor": f.rotor, "time_s": f.time, "noticed_s": self._losses.get(f.rotor)}
                for f in self._scenario.rotor_failures
            ],
            "finished": over.finished,
            "dnf_reason": None if over.finished else reason,
            "exploration": {
                "success": explorer.closed_at is not None,
                "time_s": end if explorer.closed_at is None else explorer.closed_at,
                "gates_found": len(explorer.gates),
                "events": [
                    {"time_s": e.time, "state": e.state, "reason": e.reason} for e in self._entered
                ],
            },
            **self._policy_data(),
            **({"negative_thrusts": self._negative_thrusts} if self._negative_thrusts else {}),
            **self._systems_data(),
            "laps": laps,
            "mean_lap_s": float(np.mean(times)) if times else None,
            "best_lap_s": min(times, default=None),
            "collisions": over.collisions,
            "wall": {
                **wall_data(self._simulation, self._time, wall_seconds),
                "plan_solve_times_s": [each and each.solve_time for each in summaries],
                **dict(wall),
            },
        }

    def _policy_data(self) -> dict:
        """Returns what race.json says of a policy."""
        if self._scenario.policy == NO_POLICY:
            return {}
        return {"policy": {"name": self._scenario.policy, "events": self._policy_events}}

    def _systems_data(self) -> dict:
        """Returns what race.json says of systems that are not airrace's own."""
        return {"systems": dict(self._scenario.systems)} if self._scenario.systems else {}

    def _dnf_reason(self, reason: str | None) -> str | None:
        """Returns why the race ended; for a search in vain, in which state, or for what."""
        explorer = self._explorer
        if reason != OUT_OF_TIME:
            return reason
        if not explorer.done:
            return f"{reason} in state {explorer.state}: {explorer.reason}"
        if self._plans:
            return reason
        if "lap_planner" in self._scenario.systems:
            return f"{reason}: systems.lap_planner has given no plan"
        return (
            f"{reason}: within the limits, no lap through the map's gates was found that can be "
            "entered from the hover over the start; try other --limits, or another trajectory (-t)"
        )

    def _lap(self, lap: int) -> dict:
        n = len(self._track.gates)
        crossings = self._crossings[n * (lap - 1) : n * lap + 1]
        start, (number, summary) = crossings[0].time, self._plan_of(lap)
        waited = self._delays[lap] - self._delays[lap - 1]
        return {
            "lap": lap,
            "start_s": start,
            "time_s": crossings[-1].time - start,
            **({"waited_s": waited} if waited else {}),
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
    "rotor_factors": "rotor_factors",
    "drag": "drag",
    "wind": "wind",
    "solver": "solver",
    "iterations": "iterations",
    "warm": "warm",
}


def plan_data(summary: PlanSummary) -> dict:
    """Returns what race.json says of a plan: see PlanSummary for what it is."""
    values = {name: getattr(summary, attribute) for name, attribute in _PLAN.items()}
    return {name: list(v) if isinstance(v, tuple) else v for name, v in values.items()}


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
