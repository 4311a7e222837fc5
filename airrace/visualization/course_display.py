"""A client's race on the terminal: a line for everything that happens."""

from pathlib import Path

from rich.console import Console

from airrace.common.words import count, printable
from airrace.recording import race_events as events
from airrace.scenario import Scenario
from airrace.track import Course


class CourseDisplay:
    """A sink that shows races while they run, and prints how each ended."""

    def __init__(self, scenario: Scenario, track: Course, console: Console | None = None):
        """Args: scenario, track: of the races. console: standard output by default."""
        self._scenario, self._track = scenario, track
        self._console = console or Console(highlight=False, soft_wrap=True)
        self._time, self._started, self._touched = 0.0, False, False

    def note(self, line: str) -> None:
        """Prints a line."""
        self._console.print(printable(line), markup=False)

    def announce(self, what: str) -> None:
        """Prints what takes some time."""
        self.note(f"{what} ...")

    def open(self, client: str) -> None:
        """Prints what is flown, and where a client is expected."""
        config, rate = self._scenario.mavlink, self._scenario.simulator_config.target_realtime_rate
        pace = f"{rate:g} x real time" if rate else "as fast as it can"
        pace = "one command a step" if config.step else pace
        self.note(
            f"airrace: {self._scenario.drone} on {self._track.name}, "
            f"{count(len(self._track.gates), 'gate')}, VQ{config.vq}, {pace}"
        )
        self.note(f"Waiting for a client at {client}.")

    def take(self, event: events.RaceEvent) -> None:
        """Shows what has happened."""
        if event.time < self._time:
            self._begin()
            self.note("Reset: the drone is on its pad again.")
        self._time = event.time
        match event:
            case events.ExplorerChanged() if event.status.done and not self._started:
                self._started = True
                self._at(event.status.since, "the race has started")
            case events.GateCrossed():
                crossing = event.crossing
                self._at(
                    crossing.time,
                    f"gate {crossing.gate} of {len(self._track.gates)}, {crossing.offset:.2f} m "
                    f"from its middle, at most {crossing.max_speed:.1f} m/s",
                )
            case events.ContactsCounted() if not self._touched:
                self._touched = True
                self._at(event.time, "the drone has touched something")

    def print_result(self, data: dict, folder: Path, resets: int) -> None:
        """Prints how a race ended: race.json, its folder, and how often it was reset."""
        passed = f"{data['gates_passed']} of {count(data['gates'], 'gate')}"
        collisions = sum(data["collisions"].values())
        touched = f", {count(collisions, 'sample')} with a contact" if collisions else ""
        again = f", after {count(resets, 'reset')}" if resets else ""
        if data["finished"]:
            time = f"{data['time_s']:.2f} s from the first to the last"
            self.note(f"Finished: {passed}, {time}{touched}{again}")
        else:
            self.note(f"Did not finish: {data['dnf_reason']}; {passed}{touched}{again}")
        self.note(f"Results: {folder}")
        self._begin()  # the next race is no reset

    def _begin(self):
        self._time, self._started, self._touched = 0.0, False, False

    def _at(self, time, what):
        self.note(f"[{time:7.1f} s] {what}")
