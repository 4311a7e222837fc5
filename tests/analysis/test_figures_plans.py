from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_rgb

from airrace.analysis.figures_plans import flat_outputs, planned_laps, plans_figure
from airrace.recording.json_topics import PLAN_COLUMNS, PLAN_STEP
from airrace.track import load_track
from airrace.trajopt.body_frames import body_frames
from airrace.vehicle import GRAVITY

RADIUS, RATE = 20.0, 0.5  # m, rad/s


def circuit(plan, lap, radius=RADIUS):
    """A plan of a level circle, as the log has it: in four digits."""
    times = np.arange(0.0, 2 * np.pi / RATE, PLAN_STEP)
    a, speed, zero = RATE * times, radius * RATE, 0 * times
    columns = [radius * np.cos(a), radius * np.sin(a), zero + 6.0]
    columns += [-speed * np.sin(a), speed * np.cos(a), zero, a]
    table = pd.DataFrame(np.round(columns, 4).T, columns=PLAN_COLUMNS)
    return table.assign(plan=plan, lap=lap, part="circuit", time=times)


def run_with(*circuits):
    return SimpleNamespace(track=load_track("hexagon"), plan_samples=pd.concat(circuits))


def test_attitudes_follow_from_what_the_log_has():
    position, x, z = body_frames(flat_outputs(circuit(1, 1)))
    # The ends have no neighbours on either side.
    inwards = -position[:2, 1:-1] / RADIUS
    tilt = np.arctan2(RADIUS * RATE**2, GRAVITY)
    np.testing.assert_allclose(np.sum(z[:2, 1:-1] * inwards, axis=0), np.sin(tilt), atol=1e-3)
    np.testing.assert_allclose(np.sum(x * z, axis=0), 0.0, atol=1e-12)


def test_a_plan_that_was_recorded_again_counts_once():
    run = run_with(circuit(1, 1), circuit(2, 1, radius=21.0), circuit(3, 3, radius=22.0))
    laps = planned_laps(run)
    assert list(laps) == [1, 3]
    assert laps[1]["x"].iloc[0] == 21.0 and laps[3]["x"].iloc[0] == 22.0


@pytest.mark.parametrize("count", [1, 12])
def test_all_plans_are_there_and_the_older_the_fainter(count):
    run = run_with(*(circuit(k, k, radius=20.0 + 0.1 * k) for k in range(1, count + 1)))
    (axes,) = plans_figure(run).axes
    plans = [line for line in axes.lines if len(line.get_xdata()) > 100]
    assert [line.get_xdata()[0] for line in plans] == [20.0 + 0.1 * k for k in range(1, count + 1)]
    *earlier, last = plans
    assert last.get_alpha() is None
    assert len({to_rgb(line.get_color()) for line in earlier}) == min(len(earlier), 1)
    opacities = [line.get_alpha() for line in earlier]
    assert all(0.0 < old < new <= 1.0 for old, new in zip(opacities, opacities[1:]))
    thrust, nose = axes.collections
    # Every 3 m of the last plan: the thrust leans inwards, the nose is ahead.
    assert len(nose.U) == len(thrust.U) == pytest.approx(2 * np.pi * (20 + 0.1 * count) / 3, abs=1)
    place = nose.XY
    assert np.all(np.sum(place * np.column_stack([thrust.U, thrust.V]), axis=1) < 0.0)
