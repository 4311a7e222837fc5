import io
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from airrace.recording.course_result import CourseResult
from airrace.scenario import load_scenario
from airrace.systems.types import ExplorerStatus, GateCrossing, RefereeStatus
from airrace.track import load_track
from airrace.visualization.course_display import CourseDisplay
from tests.worlds.looks import MadeUpRace

TRACK = load_track("grand-prix")


class Watching:
    """A display with a made-up race before it."""

    def __init__(self):
        self.scenario = load_scenario(filename="grand_prix")
        self.result = CourseResult(self.scenario, TRACK, "MAVLINK")
        self._file = io.StringIO()
        console = Console(file=self._file, highlight=False, soft_wrap=True)
        self.display = CourseDisplay(self.scenario, TRACK, console)
        self.begin()

    def begin(self):
        self.race = MadeUpRace(self.display.take, self.result.take)

    def look(self, time, armed=None, passed=0, contacts=0):
        crossings = tuple(
            GateCrossing(gate=i + 1, lap=1, time=5.0 + i, offset=0.25, max_speed=7.5)
            for i in range(passed)
        )
        self.race.look(
            time,
            referee_status=RefereeStatus(crossings, False, None, None, 0),
            explorer_status=ExplorerStatus(since=armed or 0.0, done=armed is not None),
            contacts=np.array([contacts, *8 * [0.0]], float),
        )

    def lines(self):
        """Returns the lines since this was called last."""
        text = self._file.getvalue()
        self._file.seek(0)
        self._file.truncate()
        return text.splitlines()


@pytest.fixture
def watching():
    return Watching()


def test_it_says_what_is_flown_and_for_whom(watching):
    config = watching.scenario.simulator_config
    paces = []
    for rate, step in ((1.0, False), (0.5, False), (0.0, False), (0.0, True)):
        config.target_realtime_rate, watching.scenario.mavlink.step = rate, step
        watching.display.open("127.0.0.1:14550")
        first, second = watching.lines()
        assert first.startswith("airrace: vadr on grand-prix, 17 gates, VQ2, ")
        assert second == "Waiting for a client at 127.0.0.1:14550."
        paces.append(first.rpartition(", ")[2])
    assert paces == ["1 x real time", "0.5 x real time", "as fast as it can", "one command a step"]


def test_everything_that_happens_is_one_line(watching):
    watching.look(0.1)
    assert watching.lines() == []
    watching.look(2.1, armed=2.0)
    assert watching.lines() == ["[    2.0 s] the race has started"]
    for _ in range(3):
        watching.look(6.5, armed=2.0, passed=2)
    gate = "of 17, 0.25 m from its middle, at most 7.5 m/s"
    assert watching.lines() == [f"[    5.0 s] gate 1 {gate}", f"[    6.0 s] gate 2 {gate}"]


def test_contacts_are_told_once(watching):
    for contacts in (0, 1, 5, 5):
        watching.look(3.0 + contacts, armed=2.0, contacts=contacts)
    assert watching.lines()[1:] == ["[    4.0 s] the drone has touched something"]


def test_after_a_reset_all_is_told_anew(watching):
    watching.look(6.5, armed=2.0, passed=1, contacts=1)
    before = watching.lines()
    watching.begin()
    watching.look(0.1)
    assert watching.lines() == ["Reset: the drone is on its pad again."]
    watching.look(6.5, armed=2.0, passed=1, contacts=1)
    assert watching.lines() == before and len(before) == 3


def test_the_next_race_is_no_reset(watching):
    watching.look(9.0, armed=2.0)
    watching.display.print_result(watching.result.data(1.0, "interrupted"), Path("here"), 0)
    watching.lines()
    watching.begin()
    watching.look(0.1)
    assert watching.lines() == []


def test_how_it_ended(watching):
    watching.look(9.0, armed=2.0, passed=1, contacts=2)
    data = watching.result.data(1.0, "ran out of time")
    watching.lines()
    watching.display.print_result(data, Path("runs/one"), 1)
    line = "Did not finish: ran out of time; 1 of 17 gates, 2 samples with a contact, after 1 reset"
    assert watching.lines() == [line, "Results: runs/one"]
    finished = data | {"finished": True, "gates_passed": 17, "time_s": 35.371, "collisions": {}}
    watching.display.print_result(finished, Path("runs/one"), 0)
    assert watching.lines()[0] == "Finished: 17 of 17 gates, 35.37 s from the first to the last"


def test_lines_are_not_markup(watching):
    watching.display.announce("Preparing [bold]")
    assert watching.lines() == ["Preparing [bold] ..."]
