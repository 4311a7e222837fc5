"""A battery: its voltage falls with the load, and with what was taken from it."""

import dataclasses as dc

import numpy as np
import pytest

from airrace.vehicle import load_vehicle
from airrace.vehicle.battery import Battery, Pack

PACK = Battery(full=16.0, empty=12.0, capacity=0.5, resistance=0.1, efficiency=0.5)


@pytest.fixture
def vehicle():
    return load_vehicle("Default")[0]


def test_voltage_falls_with_the_load_and_comes_back(vehicle):
    pack, speeds = Pack(PACK, vehicle), np.full(4, 80.0)
    pack.step(speeds, 0.001)
    power = 4 * 0.01 * 1e-3 * 80.0**3 / 0.5
    current = (16.0 - pack.voltage) / 0.1
    assert pack.voltage * current == pytest.approx(power)
    pack.step(np.zeros(4), 0.001)
    assert pack.voltage == pytest.approx(16.0, abs=1e-4) and pack.supply < 1.0


def test_what_is_taken_is_counted_to_the_end(vehicle):
    pack, speeds = Pack(PACK, vehicle), np.full(4, 80.0)
    for _ in range(3600):
        pack.step(speeds, 1.0)
    assert pack.used > PACK.capacity
    pack.step(np.zeros(4), 1.0)
    assert pack.voltage == pytest.approx(PACK.empty)


def test_more_than_it_can_give_is_half_its_voltage(vehicle):
    pack = Pack(dc.replace(PACK, resistance=10.0), vehicle)
    pack.step(np.full(4, 92.0), 0.001)
    assert pack.voltage == pytest.approx(8.0)


@pytest.mark.parametrize(
    ("change", "what"),
    [({"full": 0.0}, "positive"), ({"empty": 17.0}, "higher"), ({"efficiency": 1.5}, "above 1")],
)
def test_what_is_no_battery_is_refused(vehicle, change, what):
    with pytest.raises(ValueError, match=what):
        dc.replace(vehicle, battery=dc.replace(PACK, **change)).check()
