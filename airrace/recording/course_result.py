"""What a flight through a course of square gates leaves behind: its race.json."""

from collections.abc import Mapping
from typing import Any

from airrace.recording import race_events as events
from airrace.recording.race_result import NOT_OVER, wall_data
from airrace.scenario import Scenario
from airrace.systems.types import ExplorerStatus, GateCrossing
from airrace.track import Course
from airrace.vehicle import load_vehicle


class CourseResult:
    """A sink that collects the results of a flight through a course while it goes on.

    Attributes:
        laps_flown: none: a course has no laps.
    """

    laps_flown = 0

    def __init__(self, scenario: Scenario, track: Course, simulation: str):
        """Args: scenario, track: of the race. simulation: MAVLINK."""
        self._scenario, self._track, self._simulation = scenario, track, simulation
        self._drone = load_vehicle(scenario.drone)[0].name
        self._time, self._status = 0.0, ExplorerStatus()
        self._crossings, self._referee = list[GateCrossing](), NOT_OVER
        self._collisions = {"gate": 0, "environment": 0}

    @property
    def over(self) -> bool:
        """Whether the race has ended."""
        return self._referee.over

    def take(self, event: events.RaceEvent) -> None:
        """Takes in what has happened."""
        self._time = event.time
        match event:
            case events.ExplorerChanged():
                self._status = event.status
            case events.ContactsCounted():
                self._collisions = {"gate": event.gates, "environment": event.environment}
            case events.GateCrossed():
                self._crossings.append(event.crossing)
            case events.RaceOver():
                self._referee = event.status

    def data(
        self,
        wall_seconds: float,
        dnf_reason: str | None = None,
        wall: Mapping[str, Any] | tuple = (),
    ) -> dict:
        """Returns race.json. All but ``wall`` follows from scenario, seed and what the client did.

        Args:
            wall_seconds: what the race took.
            dnf_reason: why it ended if the referee did not end it.
            wall: what else belongs below ``wall``, a dict.
        """
        referee, crossings = self._referee, self._crossings
        times = [crossing.time for crossing in crossings]
        return {
            "track": self._track.name,
            "drone": self._drone,
            "seed": self._scenario.seed,
            "vq": self._scenario.mavlink.vq,
            "finished": referee.finished,
            "dnf_reason": None if referee.finished else referee.dnf_reason or dnf_reason,
            "start_s": self._status.since if self._status.done else None,
            "gates": len(self._track.gates),
            "gates_passed": len(crossings),
            "time_s": times[-1] - times[0] if referee.finished else None,
            "gate_times_s": [time - times[0] for time in times],
            "gate_offsets_m": [c.offset for c in crossings],
            "max_speed": max((c.max_speed for c in crossings), default=None),
            "collisions": self._collisions,
            "simulated_s": self._time,
            "wall": {**wall_data(self._simulation, self._time, wall_seconds), **dict(wall)},
        }
