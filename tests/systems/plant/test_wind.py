import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

from airrace.systems.plant.wind import PERIOD, Wind
from airrace.vehicle.disturbances import WindConfig

MEAN, RMS, TIME = [4.0, -3.0, 0.5], 2.0, 0.5
GUSTY = WindConfig(mean=MEAN, gust_rms=RMS, gust_time=TIME)


def blow(seconds, config=GUSTY, seed=0):
    """Returns the wind up to every update, one a row."""
    builder = DiagramBuilder()
    wind = builder.AddSystem(Wind(config=config, seed=seed))
    log = LogVectorOutput(wind.get_output_port(), builder, PERIOD)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(seconds)
    return log.FindLog(simulator.get_context()).data().T[1:]


def test_without_gusts_it_is_steady():
    rows = blow(1.0, WindConfig(mean=MEAN))
    np.testing.assert_allclose(rows, np.tile(MEAN, (len(rows), 1)), rtol=1e-14)
    np.testing.assert_array_equal(blow(1.0, WindConfig()), 0.0)


def test_statistics():
    """Of an Ornstein-Uhlenbeck process, within three standard errors of the estimates."""
    duration = 400.0
    gusts = blow(duration) - MEAN
    n = duration / TIME  # correlation times
    assert gusts.mean(axis=0) == pytest.approx(0.0, abs=3 * RMS * np.sqrt(2 / n))
    assert gusts.std(axis=0) == pytest.approx(RMS, rel=3 * np.sqrt(0.5 / n))
    for lag in (0.1, 0.5, 1.0):
        k = round(lag / PERIOD)
        correlation = np.mean(gusts[:-k] * gusts[k:], axis=0) / RMS**2
        assert correlation == pytest.approx(np.exp(-lag / TIME), abs=3 * np.sqrt(2 / n))
    between = np.corrcoef(gusts.T) - np.eye(3)
    assert np.abs(between).max() < 3 * np.sqrt(1 / n)


@pytest.mark.parametrize(
    "config, time",
    [
        (GUSTY, PERIOD),
        (WindConfig(MEAN, RMS, 50.0), PERIOD),
        (WindConfig(MEAN, RMS, 50.0), 0.5),
        (WindConfig(MEAN, RMS, 1e-300), 0.5),  # white
    ],
)
def test_it_is_stationary_from_the_first_sample(config, time):
    gusts = np.array([blow(time, config, seed)[-1] for seed in range(300)]) - MEAN
    assert gusts.std(axis=0) == pytest.approx(RMS, rel=3 * np.sqrt(0.5 / 300))
    assert gusts.mean(axis=0) == pytest.approx(0.0, abs=3 * RMS * np.sqrt(1 / 300))


def test_the_update_is_exact():
    """Whatever the steps of the simulator: nothing is kept outside the Context."""
    rows = blow(1.0)
    noise = (rows[1:] - MEAN) - np.exp(-PERIOD / TIME) * (rows[:-1] - MEAN)
    assert noise.std() == pytest.approx(RMS * np.sqrt(1 - np.exp(-2 * PERIOD / TIME)), rel=0.15)
    wind = Wind(config=GUSTY, seed=0)
    for step in (0.25, 0.0037):
        simulator = Simulator(wind)
        for time in np.arange(step, 0.995, step):
            simulator.AdvanceTo(time)
        simulator.AdvanceTo(0.995)
        np.testing.assert_array_equal(
            wind.get_output_port().Eval(simulator.get_context()), rows[-1]
        )


def test_the_seed_decides():
    np.testing.assert_array_equal(blow(0.5, seed=1), blow(0.5, seed=1))
    assert not np.any(blow(0.5, seed=1) == blow(0.5, seed=2))


def test_the_seed_draws_the_direction():
    """Of the mean speed alone: `mean` blows as the scenario says."""
    rows = np.array([blow(0.05, WindConfig(mean_speed=4.0), seed)[-1] for seed in range(200)])
    np.testing.assert_allclose(np.hypot(*rows[:, :2].T), 4.0)
    np.testing.assert_array_equal(rows[:, 2], 0.0)
    angles = np.sort(np.arctan2(rows[:, 1], rows[:, 0]))
    # Uniform: the greatest distance of its distribution function (Kolmogorov, 99 %).
    steps = np.arange(1, 201) / 200 - (angles + np.pi) / (2 * np.pi)
    assert np.abs(steps).max() < 1.63 / np.sqrt(200)
    both = blow(0.05, WindConfig(mean=MEAN, mean_speed=4.0), seed=7)[-1]
    np.testing.assert_allclose(both, MEAN + rows[7])
