"""A whole race, from pixels, in which every gate moves between two passages."""

import numpy as np
import pytest

from airrace.diagrams.race import run_race
from airrace.scenario import Scenario
from airrace.scenario.camera_config import CameraConfig
from airrace.track import load_track
from airrace.vehicle.disturbances import DisturbancesConfig
from tests.worlds.looks import Looks

N, LAPS = 6, 1


@pytest.fixture(scope="module")
def race(hexagon, tmp_path_factory):
    """race.json and all looks at a race."""
    scenario = Scenario(
        track=hexagon,
        laps=LAPS,
        trajectory="4",
        seed=1,
        camera=CameraConfig(preset="clean", width=640, height=360, fps=15.0),
        disturbances=DisturbancesConfig(gate_shift=1.0),
    )
    scenario.referee.time_limit = 120.0
    looks = Looks()
    folder = tmp_path_factory.mktemp("moving")
    result = run_race(scenario, folder, sinks=[looks.take])
    return load_track(hexagon), result, looks


@pytest.mark.slow
def test_it_is_finished(race):
    _, result, _ = race
    assert result["finished"] and result["collisions"] == 0
    assert result["exploration"]["gates_found"] == N and len(result["laps"]) == LAPS


def passages(looks):
    """Yields every counted passage of a gate, its index and the first look after it."""
    seen = 0
    for look in looks:
        for crossing in look.crossings[seen:]:
            yield crossing, crossing.gate - 1, look
        seen = len(look.crossings)


@pytest.mark.slow
def test_every_gate_moves_between_two_passages(race):
    _, _, looks = race
    last = {gate: np.zeros(2) for gate in range(N)}
    lengths = []
    for _, gate, look in passages(looks):
        there = look.gate_shifts.reshape(N, 2)[gate]
        lengths.append(np.linalg.norm(there - last[gate]))
        assert 0.0 < lengths[-1] <= 1.0 and np.linalg.norm(there) <= 1.0
        last[gate] = there
    assert len(lengths) == LAPS * N + 1 and max(lengths) > 0.7


@pytest.mark.slow
def test_no_gate_moves_near_the_drone(race):
    track, _, looks = race
    for before, after in zip(looks, looks[1:]):
        moved = np.any((before.gate_shifts != after.gate_shifts).reshape(N, 2), axis=1)
        for gate in np.flatnonzero(moved):
            assert np.linalg.norm(track.gates[gate].p_WG - after.state[4:7]) > 18.0


@pytest.mark.slow
def test_the_map_follows_before_the_gate_is_passed(race):
    """Within the lap: two observations in agreement beat whatever was believed before.

    They must contradict it: what is no farther off than their own errors is averaged.
    """
    track, _, looks = race
    errors = []
    for _, gate, look in passages(looks):
        truth = track.shifted(look.gate_shifts).gates[gate]
        (known,) = [g for g in look.gate_map.gates if g.number == gate]
        errors.append(np.linalg.norm(known.p_WG - truth.p_WG))
    assert max(errors) < 0.2 and np.median(errors) < 0.05, errors


@pytest.mark.slow
def test_it_is_off_by_no_more_than_the_gates_have_moved_since_the_plan(race):
    _, result, _ = race
    (lap,) = result["laps"]
    assert 0.3 < max(lap["gate_offsets_m"]) < 1.1
    # So is the map when the lap ends: half of the gates have moved since they were passed.
    assert 0.1 < lap["map_rms_m"] < 1.0
