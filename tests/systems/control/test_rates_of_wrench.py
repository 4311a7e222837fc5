"""Rates at which a rate loop asks for just the wanted moment."""

import numpy as np
import pytest

from airrace.math.quaternion import rotation_matrix
from airrace.systems.control.control_law import make_parameters
from airrace.systems.control.geometric_controller import GeometricController
from airrace.systems.control.rates_of_wrench import set_rates
from airrace.vehicle import load_vehicle


@pytest.fixture
def vehicle():
    return load_vehicle("Default")[0]


def test_a_rate_loop_asks_for_the_wrench_again(vehicle):
    random = np.random.default_rng(0)
    inertia, gains = np.array(vehicle.inertia), np.array((20.0, 25.0, 8.0))
    for _ in range(20):
        quaternion = random.normal(size=4)
        quaternion /= np.linalg.norm(quaternion)
        w_B, wrench = random.normal(size=3), random.normal(size=4)
        estimate = np.zeros(14)
        estimate[1:5] = quaternion
        estimate[8:11] = rotation_matrix(quaternion) @ w_B
        command = np.zeros(4)
        set_rates(command, wrench, estimate, inertia, gains)
        moment = inertia * gains * (command[1:] - w_B) + np.cross(w_B, inertia * w_B)
        assert command[0] == wrench[0]
        np.testing.assert_allclose(moment, wrench[1:], atol=1e-12)


def test_a_controller_commands_rates_where_it_is_told_so(vehicle):
    controller = GeometricController(vehicle=vehicle, rate=500.0, commands_rates=True)
    assert controller.GetOutputPort("rate_command").size() == 4
    assert not GeometricController(vehicle=vehicle, rate=500.0).HasOutputPort("rate_command")
    assert make_parameters(vehicle, "reduced", "vehicle").k_w.shape == (3,)
