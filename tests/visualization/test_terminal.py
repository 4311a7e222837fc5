import io
import os
import re
import types

import numpy as np
import pytest
from rich.console import Console

from airrace.recording.race_events import StateSample
from airrace.recording.race_result import RaceResult
from airrace.scenario import Scenario
from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.systems.types import ExplorerEvent, ExplorerStatus, GateCrossing, RefereeStatus
from airrace.track import load_track
from airrace.track.gate_map import GateMap
from airrace.vehicle.disturbances import RotorFailure
from airrace.vehicle.state import STATE_SIZE, as_state
from airrace.visualization.terminal import RaceDisplay, _PatientConsole, failures_line, lap_table
from tests.worlds.looks import MadeUpRace

TRACK = load_track("student-airrace")
N = len(TRACK.gates)


class Race:
    """A made-up race before a display."""

    def __init__(self, console, track=TRACK, addresses=(), laps=2, **fields):
        scenario = Scenario(laps=laps, **fields)
        self.result = RaceResult(scenario, track)
        self.display = RaceDisplay(scenario, track, addresses, console)
        self.race = MadeUpRace(self.result.take, self.display.take)

    def look(self, time, crossings=0, rotor_losses=(), delay=0.0, **status):
        seen = tuple(
            GateCrossing(10.0 + k, k % N + 1, k // N + 1, 0.1, 9.0) for k in range(crossings)
        )
        finished = crossings == 2 * N + 1
        self.display._last = -1.0  # do not wait for the next refresh
        self.race.look(
            time,
            referee_status=RefereeStatus(
                seen, finished, None, seen[-1].time if finished else None, 0
            ),
            explorer_status=ExplorerStatus(**status),
            gate_map=GateMap(),
            lap_plan=NO_PLAN,
            rotor_losses=np.array(rotor_losses),
            path_clock=np.array([0.0, delay, *[0.0] * 4]),
        )

    def fly(self):
        self.look(0.1)
        self.look(0.2)
        self.look(3.0, state="HOVER", reason="reached the hover height", since=2.9)
        self.look(6.0, state="FLY_TO_GATE", reason="gate 1", since=5.9, gates=(0,))
        done = dict(state="DONE", reason="over the start", since=9.0, done=True, gates=range(N))
        self.look(9.5, **done)
        for k in range(1, 2 * N + 2):
            self.look(9.5 + k, k, **done)
        self.display.close()
        result = self.result.data(12.0)
        self.display.print_summary(result, "runs/here")
        return result


def plain(width=100, **kwargs):
    return Console(file=io.StringIO(), width=width, **kwargs)


def test_a_log_where_there_is_no_terminal():
    console = plain()
    Race(console).fly()
    lines = console.file.getvalue().splitlines()
    assert lines[:4] == [
        "airrace: Default on student-airrace, optimal, seed 0, 2 laps",
        "[    0.0 s] CALIBRATE: power on",
        "[    2.9 s] HOVER: reached the hover height",
        "[    5.9 s] FLY_TO_GATE: gate 1",
    ]
    assert lines[5:7] == ["[   20.0 s] lap 1: 10.00 s", "[   30.0 s] lap 2: 10.00 s"]
    assert lines[-2:] == [
        "Finished: mean lap 10.00 s, best 10.00 s (the original system, from rest to rest: "
        "mean 40.60 s); 12 s to simulate, 2.5 x real time.",
        "Results: runs/here",
    ]
    assert "\x1b" not in console.file.getvalue()


def test_a_lap_in_which_the_clock_waited_says_so():
    console = plain()
    race = Race(console)
    for k, delay in ((1, 0.5), (N + 1, 0.8), (2 * N + 1, 0.8001)):  # the last is nothing to tell
        race.look(9.5 + k, k, delay=delay, done=True)
    assert console.file.getvalue().splitlines()[-2:] == [
        "[   20.0 s] lap 1: 10.00 s, in which the clock waited 0.30 s",
        "[   30.0 s] lap 2: 10.00 s",
    ]


def test_a_live_line_on_a_terminal():
    console = plain(force_terminal=True)
    race = Race(console)
    race.look(6.0, state="FLY_TO_GATE", reason="gate 1", since=5.9, gates=(0, 1))
    assert re.search("exploring, 2 gates found .* 6.0 s simulated", console.file.getvalue())
    done = dict(done=True, gates=range(N))
    race.look(9.0, **done)
    assert "lap 1/2, next gate 1 " in console.file.getvalue()
    race.look(10.0, 1, **done)
    assert "lap 1/2, next gate 2 " in console.file.getvalue()
    race.look(20.5, N + 1, **done)
    assert "lap 2/2, next gate 2 " in console.file.getvalue()
    race.look(30.5, 2 * N + 1, **done)
    race.display.close()
    race.display.close()
    # The cursor is given back.
    assert console.file.getvalue().rindex("\x1b[?25h") > console.file.getvalue().rindex("\x1b[?25l")


@pytest.mark.parametrize("width", [20, 40, 79])
def test_the_live_line_fits_a_narrow_terminal(width):
    """A line that wraps cannot be overwritten: the terminal would fill with bars."""
    console = plain(width=width, force_terminal=True)
    race = Race(console)
    for k in range(3):
        race.look(6.0 + k, state="FLY_TO_GATE", reason="gate 1", since=5.9, gates=(0, 1))
    race.display.close()
    text = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", console.file.getvalue())
    live = [line for line in re.split(r"[\r\n]", text) if line.startswith("explor")]
    assert live and all(len(line.rstrip()) <= width for line in live)


def test_nothing_is_printed_before_the_race_is_on():
    console = plain()
    Race(console).display.close()
    assert console.file.getvalue() == ""


def test_where_to_watch():
    console = plain()
    Race(console, addresses=["Watch it at http://localhost:7100"]).look(0.1)
    assert "Watch it at http://localhost:7100\n" in console.file.getvalue()


def test_systems_of_ones_own_are_named():
    console = plain()
    Race(console, systems={"geometric_controller": "my_team:make"}).look(0.1)
    assert "Your own: geometric_controller is my_team:make\n" in console.file.getvalue()


def test_a_race_that_does_not_finish():
    console = plain()
    race = Race(console)
    race.look(9.0, 5, done=True)
    race.display.print_summary(race.result.data(1.0, "interrupted"), "runs/here")
    assert (
        "Did not finish: interrupted; 1 s to simulate, 9.0 x real time.\n"
        in console.file.getvalue()
    )
    assert "lap" not in console.file.getvalue().split("Did not finish")[0].split("2 laps")[1]


def test_laps_that_flew_the_same_plan_are_named():
    race = Race(plain())
    result = race.fly()
    for numbers, sentences in (((1, 1), 1), ((1, 2), 0)):
        for lap, number in zip(result["laps"], numbers):
            lap["plan"] = {"number": number, "duration_s": 9.5}
        console = race.display._console = plain()
        race.display.print_summary(result, "runs/here")
        said = console.file.getvalue().splitlines()
        assert said.count("Lap 2 flew the plan of lap 1.") == sentences


def test_a_computer_that_was_too_slow_is_told():
    race = Race(plain())
    result = race.fly()
    for late, sentences in ((0.9, 0), (46.3, 1)):
        result["wall"]["link"] = {"late_s": late}
        console = race.display._console = plain(width=300)
        race.display.print_summary(result, "runs/here")
        said = "This computer was too slow for real time by 46 s"
        assert console.file.getvalue().count(said) == sentences


def test_a_state_that_is_told_with_its_event_later_is_told_once():
    """Over a link, an explorer's status begins without the events."""
    console = plain()
    race = Race(console)
    power_on = ExplorerEvent(0.0, "CALIBRATE", "power on")
    race.look(0.1)
    race.look(0.2, events=(power_on,))
    race.look(
        0.6, state="TAKE_OFF", since=0.5, events=(power_on, ExplorerEvent(0.5, "TAKE_OFF", "up"))
    )
    said = console.file.getvalue()
    assert said.count("power on") == 1 and said.count("TAKE_OFF: up") == 1


@pytest.mark.parametrize("field", [{"limits": "rotor"}, {"track": "hexagon"}])
def test_the_original_system_is_no_comparison_for_other_races(field):
    race = Race(plain())
    result = race.fly() | field
    console = race.display._console = plain()
    race.display.print_summary(result, "runs/here")
    assert "Finished: mean lap 10.00 s, best 10.00 s; 12 s" in console.file.getvalue()


def test_names_are_printed_as_they_are():
    """Not as rich's markup or emoji, and not broken at the end of a line."""
    name = "[red]no[/blue] :smile: [link=x]"
    console = plain(width=40)
    race = Race(console, track=types.SimpleNamespace(name=name, gates=TRACK.gates))
    race.look(0.1)
    output = f"runs/{name}/{'x' * 80}"
    race.display.print_summary(race.result.data(1.0, name), output)
    for line in (f"on {name}, optimal", f"Did not finish: {name};", f"Results: {output}\n"):
        assert line in console.file.getvalue()


def test_the_table_fits_a_narrow_terminal():
    race = Race(plain())
    result = race.fly()
    result["laps"][0]["plan"] = {"duration_s": 9.5}
    console = plain(width=80)
    console.print(lap_table(result, 5.0))
    text = console.file.getvalue()
    assert "…" not in text
    cells = [[cell.strip() for cell in line.split("│")[1:-1]] for line in text.splitlines()]
    assert ["1", "10.00", "9.50", "-", "9.0", "0.10", "-"] in cells
    assert ["2", "10.00", "-", "-", "9.0", "0.10", "-"] in cells


def laps(*times, start=100.0):
    """Laps of a race.json that take so many seconds."""
    starts = [start + sum(times[:k]) for k in range(len(times))]
    return [{"start_s": s, "time_s": t} for s, t in zip(starts, times)]


FAILURES = {
    "none": ((20.0, 21.0), (), ""),
    "before the first lap": (
        (20.0, 21.0),
        [(3, 60.0)],
        "* rotor 3 failed at 60.0 s: mean lap - before, 20.50 s after.",
    ),
    "in the second lap": (
        (20.0, 30.0, 25.0, 26.0),
        [(3, 120.0)],
        "* rotor 3 failed at 120.0 s: mean lap 20.00 s before, 25.50 s after.",
    ),
    "in the last lap": (
        (20.0, 22.0, 30.0),
        [(3, 142.5)],
        "* rotor 3 failed at 142.5 s: mean lap 21.00 s before, - after.",
    ),
    "after the last lap": ((20.0, 21.0), [(3, 141.0)], ""),
    "no laps": ((), [(3, 60.0)], ""),
    "two": (
        (20.0, 30.0, 30.0, 30.0, 26.0),
        [(1, 190.0), (3, 130.0), (2, 999.0)],
        "* rotor 3 failed at 130.0 s, rotor 1 failed at 190.0 s: "
        "mean lap 20.00 s before, 26.00 s after.",
    ),
}


@pytest.mark.parametrize("times, failures, line", FAILURES.values(), ids=FAILURES)
def test_what_failing_rotors_did(times, failures, line):
    failures = [{"rotor": rotor, "time_s": time} for rotor, time in failures]
    assert failures_line({"laps": laps(*times), "rotor_failures": failures}) == line


def test_the_lap_of_a_failure_is_marked():
    console = plain()
    race = Race(console, rotor_failures=[RotorFailure(2, 25.0), RotorFailure(4, 31.0)])
    race.fly()
    lines = console.file.getvalue().splitlines()
    cells = [line.split("│")[1].strip() for line in lines if line.startswith("│")]
    assert cells == ["1", "2 *"]
    # It began at 20 s and ended at 30 s, with the race: no lap knows the other failure.
    assert lines[-3] == "* rotor 2 failed at 25.0 s: mean lap 10.00 s before, - after."


@pytest.mark.parametrize(
    "drone, n, words",
    [
        ("Default", 4, "rotor 2 lost: the others cannot hold the yaw, coming down"),
        ("StarOne", 8, "rotor 2 lost: flying on with the other 7"),
    ],
)
def test_a_rotor_that_is_noticed_is_told_once(drone, n, words):
    console = plain()
    race = Race(console, drone=drone)
    race.look(0.1, rotor_losses=[np.inf] * n)
    for time in (25.1, 25.2):
        race.look(time, rotor_losses=[np.inf, 25.02, *[np.inf] * (n - 2)])
    assert console.file.getvalue().splitlines()[2:] == [f"[   25.0 s] {words}"]


def test_negative_thrusts_are_told_once_and_counted():
    console = plain()
    race = Race(console)
    race.look(0.1)
    for time, number in ((0.2, 50), (0.3, 100)):
        race.race.look(time, negative_thrusts=np.array([number]))
    (line,) = console.file.getvalue().splitlines()[2:]
    assert line.startswith("[    0.2 s] the controller asks for a negative thrust")
    assert race.result.data(1.0)["negative_thrusts"] == 100


def test_a_drone_that_tumbles_is_told_once():
    console = plain()
    race = Race(console)
    race.look(0.1)
    still = as_state(np.eye(STATE_SIZE)[1])
    for time, rate in ((0.2, 14.0), (0.3, 16.0), (0.4, 20.0)):
        turning = still._replace(angular_velocity=np.array([0.0, rate, 0.0]))
        race.display.take(StateSample(time, truth=turning))
    (line,) = console.file.getvalue().splitlines()[2:]
    assert line.startswith("[    0.3 s] it turns at 16 rad/s, for which the plant's steps are")


@pytest.mark.parametrize(
    "systems, lost, lines",
    [({"geometric_controller": "mine:make"}, False, 1), ({}, False, 0)]
    + [({"geometric_controller": "mine:make"}, True, 0)],
    ids=["own controller", "ours", "a rotor was lost"],
)
def test_moments_of_the_wrong_sign_are_told_once(systems, lost, lines):
    console = plain()
    race = Race(console, systems=systems)
    race.look(0.1)
    race.display._lost += [1] * lost
    race.look(
        0.6,
        state="TAKE_OFF",
        reason="level",
        since=0.5,
        events=(ExplorerEvent(0.5, "TAKE_OFF", "level"),),
    )
    still = as_state(np.eye(STATE_SIZE)[1])
    for time, lean in ((0.7, 0.2), (0.9, 1.2), (1.0, 2.0)):
        leaning = still._replace(quaternion=np.array([np.cos(lean / 2), np.sin(lean / 2), 0, 0]))
        race.display.take(StateSample(time, truth=leaning))
    told = [line for line in console.file.getvalue().splitlines() if "turns over" in line]
    assert len(told) == lines
    if lines:
        assert (
            "[    0.9 s] it turns over about its x axis, 0.4 s after take-off: moments" in told[0]
        )


@pytest.mark.parametrize("terminal", [False, True])
def test_the_race_goes_on_when_nobody_reads(terminal):
    reader, writer = os.pipe()
    os.close(reader)
    with open(writer, "w") as file:
        console = _PatientConsole(file=file, force_terminal=terminal)
        Race(console).fly()
        assert console.quiet
    # Closing the file did not raise either: what was held back is gone.


@pytest.mark.parametrize("terminal", [False, True])
def test_the_race_goes_on_when_the_disk_is_full(terminal):
    with open("/dev/full", "w") as file:
        console = _PatientConsole(file=file, force_terminal=terminal)
        Race(console).fly()
        assert console.quiet
