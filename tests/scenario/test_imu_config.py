"""Presets of the IMU, and what takes their place."""

import dataclasses as dc
import math

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator

from airrace.common.errors import UserError
from airrace.diagrams.simulation import MakeSimulation
from airrace.scenario import Scenario, load_scenario
from airrace.scenario.imu_config import PRESETS, ImuErrorsConfig
from airrace.systems.sensing.imu_samples import as_samples
from airrace.systems.types import ExplorerStatus
from airrace.vehicle import GRAVITY
from airrace.vehicle.imu_errors import ImuErrors


def loaded(text):
    scenario = load_scenario(scenario_text=f"{{estimator: vio, imu: {text}}}")
    scenario.check()
    return scenario


def test_racing_is_the_default():
    assert Scenario().imu.resolved() == PRESETS["racing"]
    assert PRESETS["ideal"] == ImuErrors()


def test_every_error_can_be_set():
    names = [field.name for field in dc.fields(ImuErrors)]
    assert [field.name for field in dc.fields(ImuErrorsConfig)] == names
    for name in names:
        errors = loaded(f"{{errors: {{{name}: 0.05}}}}").imu.resolved()
        assert errors == dc.replace(PRESETS["racing"], **{name: 0.05})


def test_zero_and_infinity_take_the_place_of_the_presets():
    errors = loaded("{preset: harsh, errors: {gyro_bias: 0, gyro_range: .inf}}").imu.resolved()
    assert errors == dc.replace(PRESETS["harsh"], gyro_bias=0.0, gyro_range=math.inf)


def test_each_preset_is_noisier():
    for name in ("gyro_noise", "accelerometer_noise"):
        noises = [getattr(PRESETS[p], name) for p in ("ideal", "bench", "a2rl", "racing", "harsh")]
        assert noises == sorted(noises) and len(set(noises)) == 5


@pytest.mark.parametrize(
    "text, words",
    [
        ("{preset: best}", "imu.preset must be one of ideal, bench, a2rl, racing, harsh, not"),
        ("{rate: 0}", "imu.rate must be at least 1, not 0"),
        ("{errors: {gyro_noise: -1}}", "imu.errors.gyro_noise must be at least 0, not -1"),
        ("{errors: {gyro_bias: 11}}", "imu.errors.gyro_bias must be at most 10, not 11"),
        ("{errors: {gyro_range: 0}}", "imu.errors.gyro_range must be positive, not 0"),
        ("{errors: {gyro_range: .nan}}", "imu.errors.gyro_range must be a positive number"),
        ("{errors: {accelerometer_walk: .inf}}", "accelerometer_walk must be a finite number"),
        ("{errors: {latency: 0.2}}", "imu.errors.latency must be at most 0.1, not 0.2"),
        ("{errors: {scale: few}}", "imu.errors.scale must be a number, not 'few'"),
        ("{errors: {drift: 1}}", "imu.errors.drift is unknown; there are: gyro_noise, gyro_bias"),
    ],
)
def test_bad_values_are_named(text, words):
    with pytest.raises(UserError, match=words) as e:
        loaded(text)
    assert "\n" not in str(e.value)


def test_the_simulations_imu_is_the_scenarios():
    """On the pad, and as often as the scenario says."""
    text = "{rate: 250, preset: ideal, errors: {latency: 0.004}}"
    simulation = MakeSimulation(loaded(text))
    context = simulation.CreateDefaultContext()
    simulation.GetInputPort("rotor_speed_command").FixValue(context, np.zeros(4))
    status = Value[object](ExplorerStatus())
    simulation.GetInputPort("explorer_status").FixValue(context, status)
    Simulator(simulation, context).AdvanceTo(0.1001)
    samples = as_samples(simulation.GetOutputPort("imu").Eval(context))
    np.testing.assert_allclose(samples.time, 0.096 - 0.004 * np.arange(10), atol=1e-9)
    assert np.abs(samples.angular_velocity).max() < 1e-6
    np.testing.assert_allclose(samples.specific_force[:, 2], GRAVITY, rtol=0.02)
