from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from airrace.analysis import load_run
from airrace.analysis.along_lap import best_lap, lap_profiles, leg_losses
from tests.worlds.made_up_run import GATES, LAP, RADIUS, TURN_RATE, make_run


def run_of(*laps):
    """A flight along x, from gate to gate at the given places (m) and times (s), lap by lap."""
    start, rows, result = 0.0, [], []
    for number, (places, times) in enumerate(laps, 1):
        rows += [(start + t, x, 0.0, 6.0, 1.0) for x, t in zip(places[:-1], times[:-1])]
        result.append(
            {
                "lap": number,
                "start_s": start,
                "time_s": times[-1],
                "gate_times_s": times[:-1],
                "gate_offsets_m": [0.0] * (len(times) - 1),
            }
        )
        start += times[-1]
        rows.append((start - 1e-9, places[-1], 0.0, 6.0, 1.0))
    rows.append((start + 0.01, 0.0, 0.0, 6.0, 1.0))
    state = pd.DataFrame(rows, columns=["time", "x", "y", "z", "speed"])
    return SimpleNamespace(state=state, result={"laps": result})


def test_laps_on_a_circle_keep_together(tmp_path):
    run = load_run(make_run(tmp_path / "run", laps=3))
    profiles = lap_profiles(run)
    assert list(profiles) == [1, 2, 3] and best_lap(run) == 1
    for profile in profiles.values():
        np.testing.assert_allclose(
            profile.gates, np.linspace(0.0, 2 * np.pi * RADIUS, GATES + 1), rtol=1e-3
        )
        np.testing.assert_allclose(profile.speed, TURN_RATE * RADIUS, rtol=1e-2)
        np.testing.assert_allclose(profile.behind(profiles[1]), 0.0, atol=2e-3)
        assert profile.time[0] == 0.0 and profile.time[-1] == LAP


def test_a_longer_lap_is_compared_at_the_same_gates():
    run = run_of(([0.0, 10.0, 40.0], [0.0, 1.0, 4.0]), ([0.0, 30.0, 40.0], [0.0, 2.0, 3.5]))
    profiles = lap_profiles(run)
    np.testing.assert_allclose(profiles[1].gates, [0.0, 30.0, 40.0], atol=1e-3)
    behind = profiles[1].behind(profiles[2])
    np.testing.assert_allclose(
        np.interp([0.0, 30.0, 40.0], profiles[1].place, behind), [0.0, -1.0, 0.5], atol=1e-6
    )
    assert {lap: lost.tolist() for lap, lost in leg_losses(run).items()} == {1: [-1.0, 1.5]}


def test_one_lap_has_nothing_to_be_compared_with():
    run = run_of(([0.0, 10.0, 40.0], [0.0, 1.0, 4.0]))
    assert leg_losses(run) == {} and list(lap_profiles(run)) == [1]


@pytest.mark.parametrize("end", [0.0, 3.9])
def test_no_profile_of_a_lap_that_was_not_recorded_to_its_end(end):
    run = run_of(([0.0, 10.0, 40.0], [0.0, 1.0, 4.0]))
    run.state = run.state[run.state["time"] < end]
    assert lap_profiles(run) == {}


def test_no_laps():
    assert best_lap(run_of()) is None and lap_profiles(run_of()) == {} == leg_losses(run_of())
