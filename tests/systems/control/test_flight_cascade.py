"""The controllers of velocity, attitude and rates together, in the plant, without a watchdog."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from airrace.math.quaternion import heading, reference_yaw, rotation_between, rotation_matrix
from airrace.systems.control.attitude_controller import MOST_RATES, AttitudeController
from airrace.systems.control.rate_controller import RateController
from airrace.systems.control.setpoint import (
    ATTITUDE,
    IDLE,
    NO_SETPOINT,
    POSITION,
    RATES,
    VELOCITY,
    setpoint_vector,
)
from airrace.systems.control.velocity_controller import VelocityController
from airrace.vehicle import DRONES
from airrace.vehicle.state import as_plant_state
from tests.worlds.hovering_plant import RATE, add_hovering_plant, hover

each = pytest.mark.parametrize("drone", DRONES)


class Flight:
    """A drone in empty space that obeys a set-point, at first in a hover."""

    def __init__(self, drone):
        builder = DiagramBuilder()
        self.vehicle, rotors, estimate = add_hovering_plant(builder, drone)
        velocity = builder.AddSystem(VelocityController(vehicle=self.vehicle))
        attitude = builder.AddSystem(AttitudeController(vehicle=self.vehicle))
        rates = builder.AddSystem(RateController(vehicle=self.vehicle, rate=RATE))
        for source, sinks in (
            (estimate.get_output_port(), (velocity, attitude, rates)),
            (velocity.get_output_port(), (attitude,)),
            (attitude.get_output_port(), (rates,)),
            (rotors.GetOutputPort("rotor_speeds"), (rates,)),
            (rates.get_output_port(), (rotors,)),
        ):
            for sink in sinks:
                builder.Connect(source, sink.GetInputPort(source.get_name()))
        builder.ExportInput(velocity.GetInputPort("watched_setpoint"), "setpoint")
        builder.ConnectInput("setpoint", attitude.GetInputPort("watched_setpoint"))
        builder.ExportOutput(attitude.get_output_port(), "rate_command")
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.context = self.simulator.get_mutable_context()
        self.most = self.vehicle.max_thrusts.sum()
        weight, speeds = hover(self.vehicle)
        self.hover = weight / self.most
        rotors.set_speeds(rotors.GetMyMutableContextFromRoot(self.context), speeds)
        rates.GetMyMutableContextFromRoot(self.context).SetDiscreteState(speeds)

    def want(self, seconds, **setpoint):
        """Flies for a while; returns the state."""
        vector = setpoint_vector(NO_SETPOINT._replace(armed=1.0, **setpoint))
        self.diagram.get_input_port().FixValue(self.context, vector)
        self.simulator.AdvanceTo(self.context.get_time() + seconds)
        return self.state

    @property
    def state(self):
        return as_plant_state(self.diagram.GetOutputPort("state").Eval(self.context).copy())

    @property
    def rate_command(self):
        return self.diagram.GetOutputPort("rate_command").Eval(self.context)


@each
def test_a_position_is_reached_and_held(drone):
    flight = Flight(drone)
    wanted = np.array([6.0, -4.0, 3.0])
    state = flight.want(6.0, kind=POSITION, position=wanted, yaw=1.0, has_yaw=1.0)
    np.testing.assert_allclose(state.position, wanted, atol=0.02)
    np.testing.assert_allclose(state.velocity, 0.0, atol=0.03)
    assert heading(state.quaternion) == pytest.approx(1.0, abs=0.01)


@each
def test_a_far_position_is_approached_at_a_limited_speed(drone):
    flight = Flight(drone)
    speeds = [
        np.linalg.norm(
            flight.want(0.25, kind=POSITION, position=np.array([90.0, 0.0, 0.0])).velocity
        )
        for _ in range(16)
    ]
    assert 7.0 < max(speeds) < 8.4


@each
@pytest.mark.parametrize(
    "wanted", [[3.0, 0.0, 0.0], [0.0, -3.0, 0.0], [1.0, 1.0, 2.0], [0, 0, -2.0]]
)
def test_a_velocity_is_followed(drone, wanted):
    flight = Flight(drone)
    state = flight.want(3.0, kind=VELOCITY, velocity=np.array(wanted))
    np.testing.assert_allclose(state.velocity, wanted, atol=0.03)
    assert heading(state.quaternion) == pytest.approx(0.0, abs=0.05)


def test_without_a_yaw_no_move_turns_the_nose():
    """Moves across the nose, again and again: their tilt is not taken for a turn."""
    flight = Flight("Default")
    flight.want(4.0, kind=VELOCITY, yaw=2.7, has_yaw=1.0)
    for speed in (5.0, -5.0, 5.0, 0.0):
        state = flight.want(2.0, kind=VELOCITY, velocity=np.array([speed, 0.0, 0.0]))
    assert heading(state.quaternion) == pytest.approx(2.7, abs=np.deg2rad(1.5))


@each
def test_a_yaw_rate_turns_the_drone(drone):
    flight = Flight(drone)
    state = flight.want(2.0, kind=VELOCITY, yaw_rate=0.5)
    rates = rotation_matrix(state.quaternion).T @ state.angular_velocity
    np.testing.assert_allclose(rates, [0.0, 0.0, 0.5], atol=0.01)
    assert heading(state.quaternion) == pytest.approx(1.0, abs=0.15)


def test_an_attitude_without_a_yaw_turns_by_its_rates():
    flight = Flight("vadr")
    q = np.array([np.cos(0.1), 0.0, np.sin(0.1), 0.0])  # pitched by 0.2 rad, at yaw 0
    rates = np.array([0.0, 0.0, 0.5])
    state = flight.want(2.0, kind=ATTITUDE, quaternion=q, rates=rates, thrust=flight.hover)
    assert reference_yaw(state.quaternion) == pytest.approx(1.0, abs=0.1)
    assert rotation_matrix(state.quaternion)[2, 2] == pytest.approx(np.cos(0.2), abs=0.01)


def test_a_height_is_held_while_a_velocity_is_flown():
    flight = Flight("vadr")
    place, level = np.array([-50.0, 70.0, 1.0]), np.array([1.0, -0.5, 0.0])
    state = flight.want(
        4.0, kind=POSITION, position=place, velocity=level, has_position=np.array([0.0, 0.0, 1.0])
    )
    np.testing.assert_allclose(state.velocity, level, atol=0.05)
    assert state.position[2] == pytest.approx(1.0, abs=0.03)


def test_an_acceleration_alone_is_flown():
    flight = Flight("vadr")
    push = np.array([1.0, 0.0, 0.5])
    state = flight.want(2.0, kind=VELOCITY, acceleration=push, has_velocity=np.zeros(3))
    np.testing.assert_allclose(state.velocity, 2.0 * push, atol=0.2)


@each
def test_an_attitude_is_taken(drone):
    flight = Flight(drone)
    half = np.array([0.2, -0.15, 0.3])
    q = np.append(np.sqrt(1.0 - half @ half), half)
    state = flight.want(2.0, kind=ATTITUDE, quaternion=q, has_yaw=1.0, thrust=flight.hover)
    assert np.linalg.norm(rotation_between(state.quaternion, q)) < 0.01
    np.testing.assert_allclose(state.angular_velocity, 0.0, atol=0.02)


@each
def test_rates_and_thrust_are_handed_on(drone):
    """As shares of all thrust; rates that no controller can follow are limited."""
    flight = Flight(drone)
    flight.want(0.0, kind=RATES, thrust=0.5, rates=np.array([1.0, -2.0, 3.0]))
    np.testing.assert_allclose(flight.rate_command, [0.5 * flight.most, 1.0, -2.0, 3.0])
    flight.want(0.0, kind=RATES, thrust=0.5, rates=np.array([99.0, -99.0, 99.0]))
    np.testing.assert_allclose(flight.rate_command[1:], MOST_RATES * [1, -1, 1])
    flight.want(0.0, kind=IDLE)
    np.testing.assert_array_equal(flight.rate_command, 0.0)


def test_thrust_in_hover_carries_the_weight():
    flight = Flight("vadr")
    state = flight.want(1.0, kind=RATES, thrust=flight.hover)
    np.testing.assert_allclose(state.velocity, 0.0, atol=0.01)
    assert flight.hover == pytest.approx(0.19, abs=0.001)
