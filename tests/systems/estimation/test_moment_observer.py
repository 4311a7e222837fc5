"""The moment observer: it finds what turns a drone, and nothing where nothing does."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator

from airrace.math.quaternion import integrate, rotation_matrix
from airrace.systems.estimation.moment_observer import MomentObserver
from airrace.vehicle import GRAVITY, load_vehicle

RATE = 500.0
VEHICLES = {name: load_vehicle(name)[0] for name in ("Default", "StarOne")}
moments = st.tuples(*[st.floats(-0.015, 0.015)] * 3).map(np.array)


class Bench:
    """A drone in free rotation, with constant speeds of its rotors and a moment beside them."""

    def __init__(self, vehicle, moment, unequal=0.0, thrust=GRAVITY):
        """Args: unequal: how much quicker the first rotor turns than the others, as a share."""
        n = len(vehicle.rotors)
        self.speeds = np.sqrt(np.full(n, vehicle.mass * thrust / n) / vehicle.thrust_coefficients)
        self.speeds[0] *= 1.0 + unequal
        self.vehicle, self.moment = vehicle, moment
        self.time, self.w, self.q = 0.0, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
        self.observer = MomentObserver(vehicle=vehicle, rate=RATE)
        self.simulator = Simulator(self.observer)
        self.context = self.simulator.get_mutable_context()
        self.observer.GetInputPort("rotor_speeds").FixValue(self.context, self.speeds)

    def fly(self, seconds, sight=True):
        """Goes on; returns the moment found. Without sight the estimate stays as it was."""
        J = np.array(self.vehicle.inertia)
        rotors = self.vehicle.allocation[1:] @ (self.vehicle.thrust_coefficients * self.speeds**2)
        port = self.observer.GetInputPort("filtered_estimate")
        for _ in range(round(seconds * RATE)):
            if sight:
                w_W = rotation_matrix(self.q) @ self.w
                estimate = [self.time, *self.q, 0, 0, 5, *w_W, 0, 0, 0]
                port.FixValue(self.context, np.array(estimate, float))
            self.simulator.AdvanceTo(self.simulator.get_context().get_time() + 1.0 / RATE)
            alpha = (rotors + self.moment - np.cross(self.w, J * self.w)) / J
            self.w = self.w + alpha / RATE
            self.q = integrate(self.q, rotation_matrix(self.q) @ self.w, 1.0 / RATE)
            self.time += 1.0 / RATE
        return self.observer.GetOutputPort("disturbance_moment").Eval(self.context).copy()


@settings(max_examples=5)
@given(moments)
@pytest.mark.parametrize("drone", VEHICLES)
def test_a_constant_moment_is_found(drone, moment):
    """Within the time constant of a third of a second, however the drone then tumbles."""
    found = Bench(VEHICLES[drone], moment).fly(1.5)
    np.testing.assert_allclose(found, moment * (1.0 - np.exp(-3.0 * 1.5)), atol=2e-4)


def test_nothing_is_found_where_the_rotors_explain_it():
    found = Bench(VEHICLES["Default"], np.zeros(3), unequal=0.01).fly(1.0)
    np.testing.assert_allclose(found, 0.0, atol=2e-4)


def test_there_is_a_most():
    vehicle = VEHICLES["Default"]
    found = Bench(vehicle, np.array([0.0, 5.0, 0.0])).fly(1.0)
    assert found[1] == pytest.approx(0.05 * np.abs(vehicle.allocation[2]) @ vehicle.max_thrusts)


def test_the_ground_is_no_disturbance():
    """With less thrust than half of the weight, the drone may stand on something."""
    found = Bench(VEHICLES["Default"], np.array([0.02, 0.0, 0.0]), thrust=4.0).fly(1.0)
    np.testing.assert_array_equal(found, 0.0)


def test_a_gap_changes_nothing():
    """What happened meanwhile is not blamed on a moment."""
    bench = Bench(VEHICLES["Default"], np.array([0.01, 0.0, 0.0]))
    before = bench.fly(1.0)
    bench.fly(0.2, sight=False)
    np.testing.assert_allclose(bench.fly(2.0 / RATE), before, atol=1e-4)


def test_an_estimate_that_is_not_finite_is_no_estimate():
    bench = Bench(VEHICLES["Default"], np.array([0.01, 0.0, 0.0]))
    before = bench.fly(1.0)
    bench.observer.GetInputPort("filtered_estimate").FixValue(bench.context, np.full(14, np.nan))
    np.testing.assert_array_equal(bench.fly(0.05, sight=False), before)
