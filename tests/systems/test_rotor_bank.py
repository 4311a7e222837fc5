import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from airrace.systems.rotor_bank import RotorBank
from airrace.vehicle import load_vehicle

VEHICLE, _ = load_vehicle("Default")


def run(command, time):
    bank = RotorBank(vehicle=VEHICLE, period=0.001)
    simulator = Simulator(bank)
    context = simulator.get_mutable_context()
    bank.get_input_port().FixValue(context, command)
    simulator.AdvanceTo(time)
    return (
        bank.GetOutputPort("rotor_speeds").Eval(context),
        bank.GetOutputPort("thrusts").Eval(context),
    )


def test_first_order_lag_whatever_the_period():
    speeds, thrusts = run([50.0, 40.0, 30.0, 20.0], 0.03)
    expected = np.array([50.0, 40.0, 30.0, 20.0]) * (1 - np.exp(-1))
    np.testing.assert_allclose(speeds, expected, rtol=1e-9)
    np.testing.assert_allclose(thrusts, 1e-3 * expected**2, rtol=1e-9)


@pytest.mark.parametrize("bad", [np.nan, -np.inf, -100.0])
def test_a_bad_command_stops_the_rotor(bad):
    speeds, thrusts = run([bad, 50.0, 50.0, 50.0], 0.3)
    assert speeds[0] == 0.0 and thrusts[0] == 0.0
    assert np.all(speeds[1:] > 49)


def test_thrust_limit():
    _, thrusts = run([1e9, np.inf, 1e3, 50.0], 1.0)
    np.testing.assert_allclose(thrusts[:3], 8.5, rtol=1e-6)
