"""The system between a controller and the rotors, with a firmware that only echoes."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from airrace.betaflight.betaflight_system import Betaflight
from airrace.betaflight.firmware_process import CHANNELS, PERIOD, REST
from airrace.betaflight.sticks import Sticks
from airrace.systems.sensing.imu_samples import NO_SAMPLES
from airrace.vehicle import load_vehicle
from airrace.vehicle.sensor_failures import RadioFailure
from tests.betaflight.test_sticks import DUMP


class Echo:
    """Its motors get the throttle of the step before."""

    def __init__(self):
        self.told = []

    def begin_step(self, imu, channels):
        self.told.append((imu.copy(), list(channels)))

    def end_step(self):
        return np.full(CHANNELS, float(self.told[-1][1][2]) if self.told else 0.0)


@pytest.fixture
def vehicle():
    return load_vehicle("Default")[0]


def fly(vehicle, steps, *, samples=NO_SAMPLES, failures=(), command=(9.81, 0.0, 0.0, 0.0)):
    """Returns what the firmware was told in each step, and the rotor speeds after them."""
    echo, builder = Echo(), DiagramBuilder()
    system = builder.AddSystem(
        Betaflight(process=echo, sticks=Sticks(DUMP, vehicle), failures=failures)
    )
    for name, value in (("rate_command", command), ("imu", samples)):
        source = builder.AddSystem(ConstantVectorSource(np.array(value)))
        builder.Connect(source.get_output_port(), system.GetInputPort(name))
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo((steps - 0.5) * PERIOD)
    context = system.GetMyContextFromRoot(simulator.get_context())
    return echo.told, system.get_output_port().Eval(context)


def test_motors_hear_of_a_step_in_the_next_one(vehicle):
    told, speeds = fly(vehicle, 1)
    assert len(told) == 1 and not speeds.any()
    told, speeds = fly(vehicle, 2)
    assert len(told) == 2
    share = (told[0][1][2] - 1000) / 1000
    np.testing.assert_allclose(speeds, share * vehicle.max_speeds)


def test_it_is_told_the_newest_sample_and_rest_before_the_first(vehicle):
    ((imu, _),) = fly(vehicle, 1)[0]
    np.testing.assert_array_equal(imu, REST)
    samples = NO_SAMPLES.copy()
    samples[:14] = [0.002, 1, 2, 3, 4, 5, 6, 0.001, 0, 0, 0, 0, 0, 0]
    ((imu, _),) = fly(vehicle, 1, samples=samples)[0]
    np.testing.assert_array_equal(imu, (1, 2, 3, 4, 5, 6))


def test_a_silent_radio_has_no_sticks(vehicle):
    told, _ = fly(vehicle, 6, failures=[RadioFailure("silent", 0.002, 0.002)])
    silent = [channels == CHANNELS * [800] for _, channels in told]
    assert silent == [False, False, True, True, False, False]
