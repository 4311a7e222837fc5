import dataclasses as dc
import json
import math
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from airrace.common.version import VERSION
from airrace.recording.race_result import RaceResult, front_marker_rms
from airrace.scenario import Scenario
from airrace.systems.planning.lap_plan import NO_PLAN, LapPlan, PlanSummary
from airrace.systems.types import ExplorerEvent, ExplorerStatus, GateCrossing, RefereeStatus
from airrace.track import load_track
from airrace.track.gate_map import GateMap, MarkerEstimate
from airrace.vehicle.disturbances import RotorFailure
from tests.worlds.looks import MadeUpRace

TRACK = load_track("student-airrace")
N = len(TRACK.gates)
RACING = ExplorerStatus(state="DONE", gates=tuple(range(N)), closed_at=60.5, done=True)


def crossings(count, start=100.0, pace=2.0):
    """The first so many crossings: a lap takes N * pace seconds."""
    return tuple(
        GateCrossing(
            time=start + pace * k,
            gate=k % N + 1,
            lap=k // N + 1,
            offset=0.01 * k,
            max_speed=10.0 + k,
        )
        for k in range(count)
    )


def referee(count, finished=False, dnf_reason=None, end_time=None, collisions=0):
    return RefereeStatus(crossings(count), finished, dnf_reason, end_time, collisions)


class Watched(RaceResult):
    """A result that is shown one moment after the other."""

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self._race = MadeUpRace(self.take)

    def look(
        self,
        time,
        referee,
        explorer,
        gate_map=None,
        plan=NO_PLAN,
        losses=(),
        shifts=None,
        clock=None,
    ):
        """Returns how many laps have ended since the last look."""
        before = self.laps_flown
        self._race.look(
            time,
            referee_status=referee,
            explorer_status=explorer,
            gate_map=gate_map,
            lap_plan=plan,
            rotor_losses=np.array(losses),
            gate_shifts=shifts,
            path_clock=clock,
        )
        return self.laps_flown - before


def plan(lap, duration):
    return LapPlan(
        lap=lap,
        start_time=0.0,
        entry=None,
        circuit=None,
        phase=0.0,
        summary=PlanSummary(
            0.25,
            duration,
            19.0,
            9.5,
            4.5,
            max_thrusts=(4.0, 4.5),
            min_thrusts=(1.0, 1.5),
            max_rate=6.0,
            clearance=2.0,
            margin=0.4,
            active_limits=("speed",),
            bound=16.0,
            solver="Clarabel",
            iterations=3,
            warm=True,
            rotor_factors=(0.97, 1.01),
            drag=(0.1, 0.006),
            wind=(3.0, 0.0, 0.0),
        ),
    )


def gate_map(error=0.0, ids=range(4 * N)):
    """A map whose markers are all off by the same distance (m)."""
    boards = {board.id: board.X_WM.translation() for board in TRACK.boards()}
    return GateMap(
        time=1.0,
        markers=tuple(
            MarkerEstimate(
                id=id,
                count=9,
                outliers=0,
                variance=np.zeros(3),
                normal=np.eye(3)[0],
                p_WM=boards.get(id, np.zeros(3)) + [0.0, error, 0.0],
            )
            for id in ids
        ),
    )


def test_before_the_first_observation():
    result = Watched(Scenario(seed=7, trajectory="4"), TRACK)
    data = result.data(0.5, "interrupted")
    assert data == {
        "track": "student-airrace",
        "drone": "Default",
        "trajectory": "4",
        "limits": "original",
        "seed": 7,
        "rotor_failures": [],
        "finished": False,
        "dnf_reason": "interrupted",
        "exploration": {"success": False, "time_s": 0.0, "gates_found": 0, "events": []},
        "laps": [],
        "mean_lap_s": None,
        "best_lap_s": None,
        "collisions": 0,
        "wall": {
            "date": data["wall"]["date"],
            "version": VERSION,
            "simulation": "SITL",
            "seconds": 0.5,
            "real_time_factor": 0.0,
            "plan_solve_times_s": [],
        },
    }
    assert abs(datetime.fromisoformat(data["wall"]["date"]) - datetime.now(UTC)) < timedelta(
        hours=1
    )
    assert result.laps_flown == 0 and not result.over
    wall = RaceResult(Scenario(), TRACK, simulation="HITL").data(1.0, wall={"link": {}})["wall"]
    assert wall["simulation"] == "HITL" and wall["link"] == {}


def test_systems_of_ones_own_are_named():
    systems = {"geometric_controller": "my_team:make"}
    assert RaceResult(Scenario(systems=systems), TRACK).data(1.0)["systems"] == systems


def test_rotor_failures_are_the_scenarios():
    scenario = Scenario(rotor_failures=[RotorFailure(3, 60.0), RotorFailure(1, 50.0)])
    result = Watched(scenario, TRACK)
    result.look(50.1, referee(0), RACING, GateMap(), NO_PLAN, np.array([50.02, *[np.inf] * 3]))
    assert result.data(1.0)["rotor_failures"] == [
        {"rotor": 3, "time_s": 60.0, "noticed_s": None},
        {"rotor": 1, "time_s": 50.0, "noticed_s": 50.02},
    ]


def test_exploring():
    result = Watched(Scenario(), TRACK)
    status = ExplorerStatus(state="HOVER", gates=(0, 1, 2))
    assert result.look(12.5, referee(0), status, gate_map(), NO_PLAN) == 0
    data = result.data(5.0, "interrupted")
    assert data["exploration"] == {
        "success": False,
        "time_s": 12.5,
        "gates_found": 3,
        "events": [{"time_s": 0.0, "state": "HOVER", "reason": "power on"}],
    }
    assert (data["wall"]["seconds"], data["wall"]["real_time_factor"]) == (5.0, 2.5)


def test_an_exploration_that_fails_took_until_the_end():
    result = Watched(Scenario(), TRACK)
    over = referee(0, dnf_reason="touched pylon_3_left", end_time=12.43, collisions=1)
    result.look(12.5, over, ExplorerStatus(gates=(0, 1)), gate_map(), NO_PLAN)
    data = result.data(5.0, "interrupted")
    explored = data["exploration"]
    assert (explored["success"], explored["time_s"], explored["gates_found"]) == (False, 12.43, 2)
    assert data["dnf_reason"] == "touched pylon_3_left"  # not what ended the loop
    assert data["collisions"] == 1 and data["finished"] is False


def test_every_event_of_the_exploration_is_kept_even_between_two_observations():
    result = Watched(Scenario(), TRACK)
    events = [ExplorerEvent(0.05 * k, "HOVER", f"reason {k}") for k in range(5)]
    for n in (2, 5):
        status = ExplorerStatus(state="HOVER", events=tuple(events[:n]))
        result.look(0.1 * n, referee(0), status, GateMap(), NO_PLAN)
    assert result.data(1.0)["exploration"]["events"] == [
        {"time_s": e.time, "state": e.state, "reason": e.reason} for e in events
    ]


def test_an_explorer_without_events_is_recorded_by_its_states():
    result = Watched(Scenario(), TRACK)
    for since, state in ((0.0, "CALIBRATE"), (0.0, "CALIBRATE"), (1.0, "MINE")):
        status = ExplorerStatus(state=state, reason="why", since=since)
        result.look(since, referee(0), status, GateMap(), NO_PLAN)
    states = [event["state"] for event in result.data(1.0)["exploration"]["events"]]
    assert states == ["CALIBRATE", "MINE"]


def test_a_search_in_vain_ends_with_what_it_tried_last():
    result = Watched(Scenario(), TRACK)
    over = referee(0, dnf_reason="ran out of time", end_time=600.0)
    status = ExplorerStatus(state="LOOK_AROUND", reason="lost, looking left", gates=(0,))
    result.look(600.0, over, status, GateMap(), NO_PLAN)
    assert result.data(1.0)["dnf_reason"] == (
        "ran out of time in state LOOK_AROUND: lost, looking left"
    )
    result.look(600.0, over, RACING, GateMap(), NO_PLAN)
    assert result.data(1.0)["dnf_reason"] == (
        "ran out of time: within the limits, no lap through the map's gates was found that can be "
        "entered from the hover over the start; try other --limits, or another trajectory (-t)"
    )
    result.look(600.0, over, RACING, GateMap(), plan(1, 19.0))
    assert result.data(1.0)["dnf_reason"] == "ran out of time"
    result = Watched(Scenario(systems={"lap_planner": "mine:make"}), TRACK)
    result.look(600.0, over, RACING, GateMap(), NO_PLAN)
    reason = result.data(1.0)["dnf_reason"]
    assert reason == "ran out of time: systems.lap_planner has given no plan"


def test_a_whole_race():
    result = Watched(Scenario(laps=2), TRACK)
    observed = [
        (99.0, referee(0), gate_map(9.0), plan(1, 19.0), 0),
        (101.0, referee(1), gate_map(9.0), plan(1, 19.0), 0),
        (119.9, referee(N), gate_map(9.0), plan(2, 18.0), 0),  # the next lap's plan is in force
        (120.1, referee(N + 1), gate_map(0.3), plan(2, 18.0), 1),
        (130.0, referee(N + 6), gate_map(9.0), plan(2, 18.0), 0),
        (140.1, referee(2 * N + 1, finished=True, end_time=140.0), gate_map(0.2), plan(3, 17.0), 1),
    ]
    for time, seen, seen_map, seen_plan, ended in observed:
        assert result.look(time, seen, RACING, seen_map, seen_plan) == ended
    assert result.laps_flown == 2
    data = result.data(70.05)
    assert data["finished"] is True and data["dnf_reason"] is None
    explored = data["exploration"]
    assert (explored["success"], explored["time_s"], explored["gates_found"]) == (True, 60.5, N)
    first, second = data["laps"]
    assert first["lap"] == 1 and second["lap"] == 2
    assert (first["start_s"], second["start_s"]) == (100.0, 120.0)
    assert first["time_s"] == second["time_s"] == 20.0
    assert first["gate_times_s"] == second["gate_times_s"] == [2.0 * k for k in range(N)]
    assert first["gate_offsets_m"] == pytest.approx([0.01 * k for k in range(N)])
    assert second["gate_offsets_m"] == pytest.approx([0.01 * (N + k) for k in range(N)])
    # The speed up to a crossing: the lap's own are those after its first.
    assert (first["max_speed"], second["max_speed"]) == (10.0 + N, 10.0 + 2 * N)
    assert first["map_rms_m"] == pytest.approx(0.3)
    assert second["map_rms_m"] == pytest.approx(0.2)
    assert first["plan"]["duration_s"] == 19.0
    said = {
        "number": 2,
        "duration_s": 18.0,
        "max_speed": 19.0,
        "max_acceleration": 9.5,
        "max_rotor_thrust": 4.5,
        "max_rate": 6.0,
        "max_rotor_thrusts": [4.0, 4.5],
        "min_rotor_thrusts": [1.0, 1.5],
        "limits_reached": ["speed"],
        "pylon_clearance_m": 2.0,
        "margin_m": 0.4,
        "bound_s": 16.0,
        "over_bound": 0.125,
        "solver": "Clarabel",
        "iterations": 3,
        "warm": True,
        "rotor_factors": [0.97, 1.01],
        "drag": [0.1, 0.006],
        "wind": [3.0, 0.0, 0.0],
    }
    assert second["plan"] == said
    assert data["mean_lap_s"] == data["best_lap_s"] == 20.0
    assert data["wall"]["plan_solve_times_s"][1] == 0.25
    assert data["wall"]["real_time_factor"] == pytest.approx(2.0)


def test_a_plan_that_is_flown_twice_counts_twice():
    result = Watched(Scenario(), TRACK)
    result.look(99.0, referee(0), RACING, gate_map(), plan(1, 19.0))
    result.look(101.0, referee(1), RACING, gate_map(), plan(2, 18.0))
    result.look(199.0, referee(3 * N + 1), RACING, gate_map(), plan(2, 18.0))
    laps = result.data(1.0)["laps"]
    assert [lap["plan"]["duration_s"] for lap in laps] == [19.0, 18.0, 18.0]
    assert [lap["plan"]["number"] for lap in laps] == [1, 2, 2]


def test_a_lap_says_how_long_the_clock_waited():
    result = Watched(Scenario(), TRACK)
    clock = np.zeros(6)
    result.look(99.0, referee(0), RACING, clock=clock)
    for lap, delay in ((0, 0.2), (1, 0.5), (2, 0.5)):
        clock[1:3] = delay, 0.1
        result.look(101.0 + 20.0 * lap, referee(lap * N + 1), RACING, clock=clock)
    assert [lap.get("waited_s") for lap in result.data(1.0)["laps"]] == [pytest.approx(0.3), None]


def test_a_lap_without_a_plan():
    """A student's planner may not say what it promises."""
    result = Watched(Scenario(), TRACK)
    result.look(199.0, referee(N + 1), RACING, GateMap(), NO_PLAN)
    (lap,) = result.data(1.0)["laps"]
    assert lap["plan"] is None and lap["map_rms_m"] is None


def test_laps_of_different_length():
    result = Watched(Scenario(), TRACK)
    slow = crossings(N + 1, pace=3.0)
    fast = crossings(2 * N + 1, start=slow[-1].time - 2.0 * N)[N + 1 :]
    result.look(
        1e3,
        RefereeStatus(slow + fast, False, "ran out of time", 9e2, 0),
        RACING,
        gate_map(),
        NO_PLAN,
    )
    data = result.data(1.0)
    assert [lap["time_s"] for lap in data["laps"]] == [30.0, 20.0]
    assert (data["mean_lap_s"], data["best_lap_s"]) == (25.0, 20.0)


@settings(deadline=None, max_examples=30)
@given(st.lists(st.integers(0, 12), max_size=12))
def test_laps_end_once_however_rarely_they_are_observed(steps):
    result = Watched(Scenario(), TRACK)
    count = ended = 0
    for step in steps:
        count += step
        seen = result.look(10.0 * count, referee(count), RACING, gate_map(0.1), NO_PLAN)
        ended += seen
        assert seen >= 0
        assert ended == result.laps_flown == max(count - 1, 0) // N
    data = result.data(1.0)
    assert [lap["lap"] for lap in data["laps"]] == list(range(1, ended + 1))
    assert all(len(lap["gate_times_s"]) == len(lap["gate_offsets_m"]) == N for lap in data["laps"])
    assert json.loads(json.dumps(data, allow_nan=False)) == data  # plain data only


class TestFrontMarkerRms:
    def test_it_is_the_distance(self):
        assert front_marker_rms(gate_map(0.0), TRACK) == pytest.approx(0.0, abs=1e-12)
        assert front_marker_rms(gate_map(0.5), TRACK) == pytest.approx(0.5)
        value = front_marker_rms(gate_map(0.5), TRACK)
        assert type(value) is float

    def test_of_some_markers(self):
        a, b = gate_map(0.3, [0]), gate_map(0.4, [2])
        both = GateMap(markers=a.markers + b.markers)
        assert front_marker_rms(both, TRACK) == pytest.approx(math.sqrt((0.09 + 0.16) / 2))

    def test_back_and_stray_markers_do_not_count(self):
        stray = gate_map(1e3, [1, 3, 5, 4 * N, 4 * N + 2, 1022])
        assert front_marker_rms(stray, TRACK) is None
        assert front_marker_rms(GateMap(), TRACK) is None
        mixed = GateMap(markers=gate_map(0.1, [4]).markers + stray.markers)
        assert front_marker_rms(mixed, TRACK) == pytest.approx(0.1)


def test_the_map_is_compared_with_where_the_gates_stand_then():
    shifts = np.zeros((N, 2))
    shifts[:, 1] = 0.5
    for moved, rms in ((shifts, 0.5), (0 * shifts, 0.0), (None, 0.0)):
        result = Watched(Scenario(), TRACK)
        given = None if moved is None else moved.ravel()
        result.look(130.0, referee(N + 1), RACING, gate_map(), NO_PLAN, shifts=given)
        assert result.data(1.0)["laps"][0]["map_rms_m"] == pytest.approx(rms)


@given(st.floats(-1.0, 1.0), st.floats(-50.0, 50.0), st.floats(-50.0, 50.0))
def test_laid_over_the_truth_a_map_that_is_off_as_a_whole_has_no_error(turn, x, y):
    c, s = np.cos(turn), np.sin(turn)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    moved = GateMap(
        markers=tuple(
            dc.replace(marker, p_WM=R @ marker.p_WM + [x, y, 0.1])
            for marker in gate_map(0.0).markers
        )
    )
    assert front_marker_rms(moved, TRACK, aligned=True) == pytest.approx(0.1)


def test_only_with_gates_that_move_and_vio_it_is_laid_over():
    errors = []
    for estimator, shifts in (("truth", np.zeros(2 * N)), ("vio", np.zeros(2 * N)), ("vio", None)):
        result = Watched(Scenario(estimator=estimator), TRACK)
        result.look(99.0, referee(N + 1), RACING, gate_map(0.5), NO_PLAN, shifts=shifts)
        errors.append(result.data(1.0)["laps"][0]["map_rms_m"])
    assert errors == pytest.approx([0.5, 0.0, 0.5], abs=1e-9)
