"""The system between a controller and the rotors, with a firmware that only echoes."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from airrace.betaflight.betaflight_system import Betaflight
from airrace.betaflight.firmware_process import CHANNELS, LEVEL, PERIOD, REST
from airrace.betaflight.sticks import Sticks
from airrace.systems.sensing.imu_samples import NO_SAMPLES
from airrace.vehicle import load_vehicle
from airrace.vehicle.battery import Battery, Pack
from airrace.vehicle.sensor_failures import RadioFailure
from tests.betaflight.test_sticks import DUMP


class Echo:
    """Its motors get the throttle of the step before."""

    def __init__(self):
        self.told = []

    def begin_step(self, imu, channels, attitude):
        self.told.append((imu.copy(), list(channels)))
        self.attitude = attitude.copy()

    def end_step(self):
        return np.full(CHANNELS, float(self.told[-1][1][2]) if self.told else 0.0)


@pytest.fixture
def vehicle():
    return load_vehicle("Default")[0]


def fly(vehicle, steps, *, samples=NO_SAMPLES, turning=0.0, **options):
    """Returns what the firmware was told in each step, and the rotor speeds after them."""
    echo, builder = Echo(), DiagramBuilder()
    system = builder.AddSystem(Betaflight(process=echo, sticks=Sticks(DUMP, vehicle), **options))
    for name, value in (
        ("rate_command", (9.81, 0.0, 0.0, 0.0)),
        ("imu", samples),
        ("rotor_speeds", np.full(4, turning)),
        ("filtered_estimate", [0.0, 1.0, *np.zeros(12)]),
        ("state", [0.6, 0.8, *np.zeros(11)]),
    ):
        source = builder.AddSystem(ConstantVectorSource(np.array(value)))
        builder.Connect(source.get_output_port(), system.GetInputPort(name))
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo((steps - 0.5) * PERIOD)
    context = system.GetMyContextFromRoot(simulator.get_context())
    np.testing.assert_array_equal(echo.attitude, LEVEL)  # sticks that ask for rates need none
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


def test_a_battery_under_load_gives_less_and_who_hears_of_it_asks_for_more(vehicle):
    weak = Battery(full=12.0, empty=12.0, capacity=1.0, resistance=0.2, efficiency=0.5)
    (_, full), (_, loaded) = (
        fly(vehicle, 2, turning=turning, pack=Pack(weak, vehicle), hears_voltage=False)
        for turning in (0.0, 90.0)
    )
    # 4 rotors x 0.01 m x 1e-3 N s^2 x 90^3 are 29.2 W, of 58.3 W: 5.35 A of 12 V - 0.2 ohm x I.
    np.testing.assert_allclose(loaded / full, 1.0 - 0.2 * 5.345 / 12.0, rtol=1e-3)
    told, heard = fly(vehicle, 2, turning=90.0, pack=Pack(weak, vehicle))
    assert told[0][1][2] > 1500 and heard[0] == pytest.approx(full[0], rel=3e-3)
