"""The learner of the air: it finds drag and wind from the disturbances on a flight."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from airrace.systems.estimation.air_learner import AirLearner, _drag_gradient
from airrace.vehicle import GRAVITY, load_vehicle
from airrace.vehicle.air import Air, air_vector, as_air, drag_acceleration

VEHICLE = load_vehicle("Default")[0]
HOVER = np.sqrt(VEHICLE.mass * GRAVITY / VEHICLE.thrust_coefficients.sum())
AIR = Air(0.08, 0.008, np.array([3.0, -2.0, 0.0]))
UP = np.array([0.0, 0.0, 1.0])
NOTHING = np.zeros(3)


def learnt(air, seconds=30.0, speed=25.0, noise=0.5, thrust=1.0):
    """Returns what is told of an air after level circles in it."""
    learner = AirLearner(vehicle=VEHICLE, rate=AirLearner.RATE)
    simulator = Simulator(learner)
    context = simulator.get_mutable_context()
    rng = np.random.default_rng(0)
    learner.GetInputPort("rotor_speeds").FixValue(context, np.full(4, HOVER) * np.sqrt(thrust))
    for time in np.arange(0.0, seconds, 1.0 / AirLearner.RATE):
        velocity = speed * np.array([np.cos(time), np.sin(time), 0.2 * np.sin(3.0 * time)])
        disturbance = drag_acceleration(velocity, UP, air) + noise * rng.standard_normal(3)
        estimate = np.array([time, 1.0, *[0.0] * 9, *velocity])
        learner.GetInputPort("filtered_estimate").FixValue(context, estimate)
        learner.GetInputPort("disturbance").FixValue(context, disturbance)
        simulator.AdvanceTo(time + 0.9 / AirLearner.RATE)
    return as_air(learner.GetOutputPort("air").Eval(context).copy())


def test_drag_and_wind_are_found():
    found = learnt(AIR)
    np.testing.assert_allclose(found.wind, AIR.wind, atol=0.5)
    for speed in (10.0, 25.0):
        v = np.array([speed, 0.0, 0.0])
        wanted = drag_acceleration(v, UP, AIR)
        np.testing.assert_allclose(drag_acceleration(v, UP, found), wanted, atol=0.4)
    more = np.array(VEHICLE.drag.linear[2]) / VEHICLE.drag.linear[0] - 1.0
    assert found.axial_linear == pytest.approx(more * found.linear)
    assert found.axial_quadratic == pytest.approx(found.quadratic)  # twice as much, in the file


@pytest.mark.parametrize(
    "flight", [dict(air=AIR._replace(linear=0.0, quadratic=0.0)), dict(air=AIR, thrust=0.4)]
)
def test_where_there_is_no_drag_none_is_told(flight):
    """Or where the ground may carry the drone."""
    found = learnt(seconds=10.0, **flight)
    assert found.is_still


def test_the_gradient_is_that_of_the_drag():
    v, z, more = np.array([4.0, -7.0, 1.0]), np.array([0.6, 0.0, 0.8]), np.array([-0.5, 1.0])
    theta = air_vector(AIR)[:5]

    def drag(theta):
        return drag_acceleration(v, z, Air(*theta[:2], theta[2:], *more * theta[:2]))

    air = AIR._replace(axial_linear=more[0] * AIR.linear, axial_quadratic=more[1] * AIR.quadratic)
    for k, step in enumerate(1e-6 * np.eye(5)):
        slope = drag(theta + step) - drag(theta - step)
        np.testing.assert_allclose(_drag_gradient(v, z, air, more)[:, k], slope / 2e-6, atol=1e-5)
