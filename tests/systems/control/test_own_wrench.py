"""A controller of one's own: what it asks for is checked before the rotors share it."""

import numpy as np
import pytest

from airrace.common.errors import UserError
from airrace.systems.control.geometric_controller import GeometricController
from airrace.trajopt.flat_trajectory import hold
from airrace.vehicle import load_vehicle
from airrace.vehicle.state import State, state_vector

VEHICLE, _ = load_vehicle("Default")
REST = state_vector(State(0.0, np.array([1.0, 0, 0, 0]), np.zeros(3), np.zeros(3), np.zeros(3)))


class Mine(GeometricController):
    """Asks for what a test wants."""

    asked = None

    def calc_wrench(self, reference, estimate):
        return super().calc_wrench(reference, estimate) if self.asked is None else self.asked[0]


def updated(controller, state=REST):
    """Returns command and context after an update in which all is at rest."""
    context = controller.CreateDefaultContext()
    n = len(VEHICLE.rotors)
    for name, value in {
        "reference": hold([0, 0, 0], 0.0),
        "filtered_estimate": state,
        "disturbance": np.zeros(3),
        "rotor_speeds": np.zeros(n),
        "rotor_losses": np.full(n, np.inf),
    }.items():
        controller.GetInputPort(name).FixValue(context, value)
    discrete = controller.EvalUniquePeriodicDiscreteUpdate(context)
    context.SetDiscreteState(discrete)
    return controller.GetOutputPort("rotor_speed_command").Eval(context), context


def test_it_flies_as_the_class_that_it_is_made_from():
    usual, _ = updated(GeometricController(vehicle=VEHICLE, rate=500.0))
    mine, context = updated(Mine(vehicle=VEHICLE, rate=500.0))
    np.testing.assert_array_equal(mine, usual)
    assert usual.any() and context.num_discrete_state_groups() == 2


@pytest.mark.parametrize(
    "wrench", [np.ones(3), np.ones((4, 4)), [9.0, 0.0, np.nan, 0.0], (None,), "up", np.ones(5)]
)
def test_what_is_no_wrench_is_said(wrench):
    controller = Mine(vehicle=VEHICLE, rate=500.0)
    controller.asked = [wrench]
    with pytest.raises(UserError, match=r"Mine.calc_wrench\(\) gave .*; it must give total thrust"):
        updated(controller)


def test_nothing_is_a_sentence_too():
    controller = Mine(vehicle=VEHICLE, rate=500.0)
    controller.asked = [None]
    with pytest.raises(UserError, match=r"gave None \(NoneType\)"):
        updated(controller)


def test_a_list_is_as_good_as_an_array():
    controller = Mine(vehicle=VEHICLE, rate=500.0)
    controller.asked = [[10.0, 0.0, 0.0, 0.0]]
    command, _ = updated(controller)
    controller.asked = [np.array([10.0, 0.0, 0.0, 0.0])]
    np.testing.assert_array_equal(command, updated(controller)[0])


def test_a_negative_thrust_is_none_and_counted():
    controller = Mine(vehicle=VEHICLE, rate=500.0)
    controller.asked = [[-10.0, 0.0, 0.0, 0.0]]
    command, context = updated(controller)
    assert not command.any()
    assert controller.GetOutputPort("negative_thrusts").Eval(context) == [1.0]


def test_nothing_is_asked_of_a_wrench_where_the_estimate_is_not_finite():
    controller = Mine(vehicle=VEHICLE, rate=500.0)
    controller.asked = [[np.nan] * 4]
    command, _ = updated(controller, np.full(14, np.nan))
    assert not command.any()  # the last one is held
