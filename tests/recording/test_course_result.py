import json

import numpy as np
import pytest

from airrace.recording.course_result import CourseResult
from airrace.scenario import load_scenario
from airrace.systems.types import ExplorerStatus, GateCrossing, RefereeStatus
from airrace.track import load_track
from tests.worlds.looks import MadeUpRace

TRACK = load_track("grand-prix")
N = len(TRACK.gates)


def crossings(number):
    return tuple(
        GateCrossing(gate=i + 1, lap=1, time=10.0 + 2.0 * i, offset=0.01 * i, max_speed=5.0 + i)
        for i in range(number)
    )


@pytest.fixture
def result():
    return CourseResult(load_scenario(filename="grand_prix"), TRACK, "MAVLINK")


@pytest.fixture
def look(result):
    """Shows the result a made-up moment."""
    race = MadeUpRace(result.take)

    def look(time, passed=0, over=None, end=None, armed=None, gates=0, environment=0):
        status = ExplorerStatus() if armed is None else ExplorerStatus(since=armed, done=True)
        race.look(
            time,
            referee_status=RefereeStatus(crossings(passed), over == "finished", over, end, 0),
            explorer_status=status,
            contacts=np.array([gates, environment, *7 * [0.0]], float),
        )
        assert result.laps_flown == 0  # a course has no laps

    return look


def test_on_the_pad_there_is_nothing_to_tell(result, look):
    look(0.5)
    data = result.data(wall_seconds=1.0, dnf_reason="not over yet")
    assert (data["track"], data["drone"], data["vq"]) == ("grand-prix", "vadr", 2)
    assert not data["finished"] and data["dnf_reason"] == "not over yet"
    assert (data["gates"], data["gates_passed"], data["gate_times_s"]) == (N, 0, [])
    assert data["start_s"] is data["time_s"] is data["max_speed"] is None
    assert data["collisions"] == {"gate": 0, "environment": 0}


def test_a_race_is_timed_from_the_first_gate_to_the_last(result, look):
    look(3.0, armed=2.5)
    look(50.0, passed=N, over="finished", end=10.0 + 2.0 * N, armed=2.5)
    data = result.data(wall_seconds=25.0, dnf_reason="interrupted", wall={"link": {"sent": 3}})
    assert data["finished"] and data["dnf_reason"] is None
    assert data["start_s"] == 2.5 and data["time_s"] == 2.0 * (N - 1)
    assert data["gate_times_s"] == [2.0 * i for i in range(N)]
    assert data["gate_offsets_m"][-1] == pytest.approx(0.01 * (N - 1))
    assert data["max_speed"] == 5.0 + N - 1
    assert data["wall"]["link"] == {"sent": 3} and data["wall"]["simulation"] == "MAVLINK"
    json.dumps(data, allow_nan=False)  # as it is written


def test_a_race_that_is_not_finished_says_why_and_how_far_it_came(result, look):
    look(20.0, passed=3, armed=2.5, gates=2, environment=1)
    data = result.data(1.0, "ran out of time")
    assert data["dnf_reason"] == "ran out of time" and data["time_s"] is None
    assert (data["gates_passed"], data["max_speed"]) == (3, 7.0)
    assert data["collisions"] == {"gate": 2, "environment": 1}
    # What the referee says counts more.
    look(21.0, passed=3, over="left the arena", end=21.0, armed=2.5)
    assert result.data(1.0, "ran out of time")["dnf_reason"] == "left the arena"
