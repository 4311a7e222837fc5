"""The rate controller: rates follow, in the plant, with the rotors' lag and limits."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from airrace.math.quaternion import rotation_matrix
from airrace.systems.control.rate_controller import RateController
from airrace.vehicle import load_vehicle
from airrace.vehicle.state import as_plant_state
from tests.worlds.hovering_plant import DT, RATE, add_hovering_plant, hover

VEHICLES = {name: load_vehicle(name)[0] for name in ("Default", "StarOne")}
both_drones = pytest.mark.parametrize("drone", VEHICLES)


class Flight:
    """A drone in empty space with its rate controller, at first in a hover."""

    def __init__(self, drone):
        builder = DiagramBuilder()
        self.vehicle, rotors, estimate = add_hovering_plant(builder, drone)
        controller = builder.AddSystem(RateController(vehicle=self.vehicle, rate=RATE))
        for source, sink, port in (
            (estimate, controller, "filtered_estimate"),
            (rotors, controller, "rotor_speeds"),
            (controller, rotors, "rotor_speed_command"),
        ):
            builder.Connect(source.GetOutputPort(port), sink.GetInputPort(port))
        builder.ExportInput(controller.GetInputPort("rate_command"), "rate_command")
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.context = self.simulator.get_mutable_context()
        self.weight, speeds = hover(self.vehicle)
        rotors.set_speeds(rotors.GetMyMutableContextFromRoot(self.context), speeds)
        context = controller.GetMyMutableContextFromRoot(self.context)
        context.SetDiscreteState(speeds)

    def command(self, f, rates):
        self.diagram.get_input_port().FixValue(self.context, [f, *rates])

    def rates(self, seconds):
        """Flies on; returns the rates of the body at every millisecond, (n, 3)."""
        start, result = self.context.get_time(), []
        for k in range(1, round(seconds / DT) + 1):
            self.simulator.AdvanceTo(start + k * DT)
            state = as_plant_state(self.diagram.get_output_port().Eval(self.context))
            result.append(rotation_matrix(state.quaternion).T @ state.angular_velocity)
        return np.array(result)


@both_drones
@pytest.mark.parametrize("axis", [0, 1])
def test_roll_and_pitch_follow_a_step_within_40_ms(drone, axis):
    flight = Flight(drone)
    wanted = np.zeros(3)
    wanted[axis] = 5.0
    half = flight.vehicle.max_thrusts.sum() / 2
    flight.command(half, np.zeros(3))
    flight.rates(0.1)
    flight.command(half, wanted)
    rates = flight.rates(0.3)
    assert np.argmax(rates[:, axis] > 0.63 * 5.0) < 40
    assert rates[:, axis].max() < 1.1 * 5.0
    np.testing.assert_allclose(rates[-1], wanted, atol=0.1)
    others = np.delete(rates, axis, axis=1)
    assert np.abs(others).max() < 0.05


@both_drones
def test_yaw_follows_as_fast_as_the_rotors_can(drone):
    flight = Flight(drone)
    flight.command(flight.weight, [0.0, 0.0, 1.0])
    rates = flight.rates(1.0)
    assert np.argmax(rates[:, 2] > 0.63) < 400
    np.testing.assert_allclose(rates[-1], [0.0, 0.0, 1.0], atol=0.02)
    assert rates[:, 2].max() < 1.1


@both_drones
def test_a_spin_about_all_axes_is_stopped(drone):
    flight = Flight(drone)
    flight.command(flight.vehicle.max_thrusts.sum() / 2, [8.0, -8.0, 1.0])
    flight.rates(0.3)
    flight.command(flight.vehicle.max_thrusts.sum() / 2, np.zeros(3))
    np.testing.assert_allclose(flight.rates(0.8)[-1], 0.0, atol=0.05)


@both_drones
def test_at_all_thrust_it_still_turns(drone):
    flight = Flight(drone)
    flight.command(flight.vehicle.max_thrusts.sum(), [0.0, 0.0, 0.0])
    flight.rates(0.2)
    flight.command(flight.vehicle.max_thrusts.sum(), [10.0, 0.0, 0.0])
    assert np.argmax(flight.rates(0.3)[:, 0] > 0.63 * 10.0) < 60


class Bench:
    """The controller alone, its inputs fixed."""

    def __init__(self):
        self.controller = RateController(vehicle=VEHICLES["Default"], rate=RATE)
        self.context = self.controller.CreateDefaultContext()
        weight, speeds = hover(VEHICLES["Default"])
        self.hover = [weight, 0.0, 0.0, 0.0]
        self.estimate = np.array([0.0, 1, 0, 0, 0, 0, 0, 5, 0, 0, 0, 0, 0, 0])
        self.fix(rate_command=self.hover, filtered_estimate=self.estimate, rotor_speeds=speeds)
        self.speeds = speeds

    def fix(self, **values):
        for name, value in values.items():
            self.controller.GetInputPort(name).FixValue(self.context, value)

    def command(self):
        after = self.controller.EvalUniquePeriodicDiscreteUpdate(self.context)
        self.context.SetDiscreteState(after.value().copy())
        return self.controller.GetOutputPort("rotor_speed_command").Eval(self.context)


@pytest.mark.parametrize("port", ["rate_command", "filtered_estimate"])
def test_what_is_not_finite_holds_the_last_command(port):
    bench = Bench()
    before = bench.command()
    value = {"rate_command": np.array(bench.hover), "filtered_estimate": bench.estimate}[port]
    bench.fix(**{port: np.where(np.arange(len(value)) == 2, np.nan, value)})
    np.testing.assert_array_equal(bench.command(), before)
    np.testing.assert_allclose(before, bench.speeds)


def test_a_rotor_that_reports_no_speed_is_not_driven():
    bench = Bench()
    bench.fix(rotor_speeds=np.where(np.arange(4) == 1, np.nan, bench.speeds))
    command = bench.command()
    assert command[1] == 0.0
    np.testing.assert_allclose(np.delete(command, 1), np.delete(bench.speeds, 1))
