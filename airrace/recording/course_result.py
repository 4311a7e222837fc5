"""What a flight through a course of square gates leaves behind: its race.json."""

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

from airrace.recording.race_result import wall_data
from airrace.scenario import Scenario
from airrace.systems.sensing.contact_sensor import as_contacts
from airrace.systems.types import ExplorerStatus, RefereeStatus
from airrace.track import Course
from airrace.vehicle import load_vehicle


class CourseResult:
    """Collects the results of a flight through a course while it goes on.

    Attributes:
        vehicle: the drone, as its file says.
        referee_status: the latest.
        collisions: samples with a contact so far, with gates and with the environment.
    """

    def __init__(self, scenario: Scenario, track: Course, simulation: str):
        """Args: scenario, track: of the race. simulation: MAVLINK."""
        self._scenario, self._track, self._simulation = scenario, track, simulation
        self._time, self._status = 0.0, ExplorerStatus()
        self.vehicle = load_vehicle(scenario.drone)[0]
        self.referee_status = RefereeStatus((), False, None, None, 0)
        self.collisions = {"gate": 0, "environment": 0}

    def observe(self, outputs: SimpleNamespace) -> int:
        """Takes in what the race's outputs say now; returns 0: a course has no laps.

        Args:
            outputs: a namespace of ``time`` (s) and of the values of the outputs at that time,
                ``referee_status``, ``explorer_status`` and ``contacts``.
        """
        self._time, self.referee_status = outputs.time, outputs.referee_status
        self._status = outputs.explorer_status
        contacts = as_contacts(outputs.contacts)
        self.collisions = {"gate": int(contacts.gates), "environment": int(contacts.environment)}
        return 0

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
        referee = self.referee_status
        crossings = referee.crossings
        first = crossings[0].time if crossings else None
        return {
            "track": self._track.name,
            "drone": self.vehicle.name,
            "seed": self._scenario.seed,
            "vq": self._scenario.mavlink.vq,
            "finished": referee.finished,
            "dnf_reason": None if referee.finished else referee.dnf_reason or dnf_reason,
            "start_s": self._status.since if self._status.done else None,
            "gates": len(self._track.gates),
            "gates_passed": len(crossings),
            "time_s": crossings[-1].time - crossings[0].time if referee.finished else None,
            "gate_times_s": [c.time - first for c in crossings],
            "gate_offsets_m": [c.offset for c in crossings],
            "max_speed": max((c.max_speed for c in crossings), default=None),
            "collisions": self.collisions,
            "simulated_s": self._time,
            "wall": {**wall_data(self._simulation, self._time, wall_seconds), **dict(wall)},
        }
