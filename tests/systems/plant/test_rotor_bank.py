import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from airrace.systems.plant.rotor_bank import RotorBank
from airrace.vehicle import load_vehicle

VEHICLE, _ = load_vehicle("Default")


def run(command, time, failures=()):
    bank = RotorBank(vehicle=VEHICLE, period=0.001, failures=failures)
    simulator = Simulator(bank)
    context = simulator.get_mutable_context()
    bank.GetInputPort("rotor_speed_command").FixValue(context, command)
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


def test_a_rotor_that_fails_spins_down():
    command = [60.0, 50.0, np.inf, 30.0]
    speeds, _ = run(command, 1.0, failures=[(0, 0.5), (2, 0.94)])
    healthy, _ = run(command, 1.0)
    np.testing.assert_array_equal(speeds[[1, 3]], healthy[[1, 3]])
    # With the first step at the very time of the failure.
    assert speeds[2] == pytest.approx(healthy[2] * np.exp(-2), rel=1e-6)
    assert speeds[0] == pytest.approx(60.0 * np.exp(-0.5 / 0.03), rel=1e-6)


def test_a_rotor_that_has_not_failed_yet_is_healthy():
    np.testing.assert_array_equal(run([50.0] * 4, 0.5, failures=[(1, 0.5)]), run([50.0] * 4, 0.5))
    speeds, _ = run([50.0] * 4, 0.5, failures=[(1, 0.0)])
    assert speeds[1] == 0.0 and np.all(speeds[[0, 2, 3]] > 49)


def test_the_report_has_what_a_failed_rotor_should_do():
    command = [60.0, np.nan, np.inf, 30.0]
    bank = RotorBank(vehicle=VEHICLE, period=0.001, failures=[(0, 0.5), (2, 0.94)])
    simulator = Simulator(bank)
    context = simulator.get_mutable_context()
    bank.GetInputPort("rotor_speed_command").FixValue(context, command)
    np.testing.assert_array_equal(bank.GetOutputPort("rotor_status").Eval(context), np.zeros(9))
    simulator.AdvanceTo(0.999)
    simulator.AdvancePendingEvents()
    report = bank.GetOutputPort("rotor_status").Eval(context)
    assert report[0] == pytest.approx(1.0)
    np.testing.assert_array_equal(report[1:5], bank.GetOutputPort("rotor_speeds").Eval(context))
    np.testing.assert_array_equal(report[5:], run(command, 1.0)[0])


def test_speeds_that_are_set_are_those_expected():
    bank = RotorBank(vehicle=VEHICLE, period=0.001)
    context = bank.CreateDefaultContext()
    context.SetTime(0.5)
    bank.set_speeds(context, [10.0, 20.0, 30.0, 40.0])
    np.testing.assert_array_equal(
        bank.GetOutputPort("rotor_status").Eval(context), [0.5, *2 * [10.0, 20.0, 30.0, 40.0]]
    )
