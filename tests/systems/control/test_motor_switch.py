import numpy as np
import pytest

from airrace.systems.control.motor_switch import MotorSwitch
from airrace.systems.control.setpoint import (
    ATTITUDE,
    IDLE,
    MOTORS,
    NO_SETPOINT,
    POSITION,
    RATES,
    VELOCITY,
    setpoint_vector,
)
from airrace.vehicle import load_vehicle

VEHICLE, _ = load_vehicle("vadr")
CONTROLLED = np.array([800.0, 900.0, 1000.0, 1100.0])


def command(**setpoint):
    switch = MotorSwitch(vehicle=VEHICLE)
    context = switch.CreateDefaultContext()
    vector = setpoint_vector(NO_SETPOINT._replace(**setpoint))
    switch.GetInputPort("watched_setpoint").FixValue(context, vector)
    switch.GetInputPort("controlled_speeds").FixValue(context, CONTROLLED)
    return switch.get_output_port().Eval(context)


@pytest.mark.parametrize("kind", [RATES, ATTITUDE, VELOCITY, POSITION])
def test_controllers_have_the_motors_while_the_drone_is_armed(kind):
    np.testing.assert_array_equal(command(kind=kind, armed=1.0), CONTROLLED)
    np.testing.assert_array_equal(command(kind=kind, armed=0.0), 0.0)


def test_motors_stand_still_if_nothing_is_wanted():
    np.testing.assert_array_equal(command(kind=IDLE, armed=1.0), 0.0)
    np.testing.assert_array_equal(command(kind=MOTORS, armed=0.0, motors=np.ones(4)), 0.0)


def test_shares_are_of_each_rotors_greatest_thrust():
    shares = np.array([0.0, 0.25, 0.5, 1.0])
    speeds = command(kind=MOTORS, armed=1.0, motors=shares)
    thrusts = VEHICLE.thrust_coefficients * speeds**2
    np.testing.assert_allclose(thrusts, shares * VEHICLE.max_thrusts)
    beyond = command(kind=MOTORS, armed=1.0, motors=np.array([-1.0, 2.0, 0.0, 0.0]))
    np.testing.assert_allclose(beyond, [0.0, VEHICLE.max_speeds[1], 0.0, 0.0])
