"""Flights without a race: the drone is steered by what it may know, and well."""

import textwrap

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.systems.analysis import Simulator

from airrace.diagrams.flight import CONTROL, MakeFlight, start_in_flight
from airrace.scenario import ControllerConfig, Scenario
from airrace.systems.control.attitude_error import rotation_matrix
from airrace.track import load_track
from airrace.trajopt.flat_trajectory import flat_outputs, hold
from airrace.trajopt.flatness import attitude_from_force, heading_vectors
from airrace.trajopt.min_snap.circuit import plan_circuit
from airrace.trajopt.reference import as_reference
from airrace.vehicle import DRONES, GRAVITY
from airrace.vehicle.disturbances import DisturbancesConfig, RotorFailure, WindConfig

LEVEL = RotationMatrix()
STEP = 0.02  # s, between two looks
both_drones = pytest.mark.parametrize("drone", DRONES)


def scenario(drone="Default", **fields):
    return Scenario(drone=drone, **{"laps": 1, "state_noise": "none", **fields})


def fly(flown, reference, seconds, R=None, until=lambda state: False):
    """Starts on the reference, or in another attitude; returns states and losses.

    Args:
        until: ends the flight, from the state (13).
    """
    flight = MakeFlight(flown, reference)
    simulator = Simulator(flight)
    context = simulator.get_mutable_context()
    start = reference(0.0)
    w_W = np.zeros(3)
    if R is None:
        force = as_reference(start).acceleration + [0.0, 0.0, GRAVITY]
        heading = heading_vectors(np.cos(start[15]), np.sin(start[15]), *start[16:].tolist())
        axes, w, _ = attitude_from_force(
            force, as_reference(start).jerk, as_reference(start).snap, heading
        )
        R = RotationMatrix(np.array(axes).T)
        w_W = R @ np.array(w)
    start_in_flight(
        flight,
        flown,
        context,
        X_WB=RigidTransform(R, start[:3]),
        w_WB=w_W,
        v_WB=as_reference(start).velocity,
    )
    simulator.Initialize()
    states = []
    while len(states) < round(seconds / STEP):
        simulator.AdvanceTo((len(states) + 1) * STEP)
        states.append(flight.GetOutputPort("truth.state").Eval(context).copy())
        if until(states[-1]):
            break
    return np.array(states), flight.GetOutputPort("rotor_losses").Eval(context).copy()


def hover(height):
    return lambda time: hold([0.0, 0.0, height], 0.0)


def lap():
    """The reference track's, from a straight part of it."""
    track = load_track("student-airrace")
    circuit = plan_circuit(
        [gate.p_WG for gate in track.gates],
        [gate.heading for gate in track.gates],
        track.pylons()[:, :2],
        3,
        max_speed=20.0,
        max_acceleration=10.0,
        clearance=2.0,
    )
    return lambda time: flat_outputs(circuit.derivatives(time % circuit.duration))


def errors(states, reference):
    """Returns the distance to the reference at every look."""
    times = STEP * np.arange(1, len(states) + 1)
    return np.linalg.norm(states[:, 4:7] - [reference(t)[:3] for t in times], axis=1)


def tilt(state):
    return np.arccos(np.clip(rotation_matrix(*state[:4].tolist())[2, 2], -1.0, 1.0))


def test_the_outputs():
    flight = MakeFlight(scenario(), hover(5.0))
    names = [flight.get_output_port(i).get_name() for i in range(flight.num_output_ports())]
    assert names == ["truth.state", "truth.referee_status", "rotor_speeds", "rotor_losses"]
    assert flight.num_input_ports() == 0


def sources(flight, box):
    """Yields the input ports of a box, and the names of producer and output port."""
    for (consumer, i), (producer, o) in flight.connection_map().items():
        if consumer.get_name() == box:
            yield (
                consumer.get_input_port(i).get_name(),
                producer.get_name(),
                producer.get_output_port(o).get_name(),
            )


def test_what_controls_never_sees_the_truth():
    """Of the simulated world it sees the state estimate, and what the motors report."""
    flight = MakeFlight(scenario(), hover(5.0))
    for box in CONTROL:
        fed = list(sources(flight, box))
        assert len(fed) == flight.GetSubsystemByName(box).num_input_ports()
        for port, producer, output in fed:
            assert port == output
            assert producer in ("reference_source", *CONTROL) or (
                producer == "simulation"
                and port in ("state_estimate", "rotor_speeds", "rotor_status")
            )
    simulation = flight.GetSubsystemByName("simulation")
    estimate = simulation.GetOutputPort("state_estimate").get_index()
    system, _ = simulation.get_output_port_locator(estimate)
    assert type(system).__name__ == "StateEstimate"


def test_a_box_cannot_ask_for_the_truth(tmp_path, monkeypatch):
    (tmp_path / "curious_box.py").write_text(
        textwrap.dedent("""
        from airrace.systems.control.state_filter import StateFilter
        from airrace.vehicle import load_vehicle

        class Curious(StateFilter):
            def __init__(self, scenario):
                vehicle, _ = load_vehicle(scenario.drone)
                super().__init__(vehicle=vehicle, state_rate=200.0, rate=500.0)
                self.DeclareVectorInputPort("truth.state", 13)
    """)
    )
    monkeypatch.syspath_prepend(tmp_path)
    flight = MakeFlight(scenario(systems={"state_filter": "curious_box:Curious"}), hover(5.0))
    assert "truth.state" not in [port for port, _, _ in sources(flight, "state_filter")]


@both_drones
def test_a_hover_stays(drone):
    states, losses = fly(scenario(drone), hover(8.0), 1.0)
    assert errors(states, hover(8.0)).max() < 0.002
    assert np.linalg.norm(states[-1, 7:]) < 0.01
    assert np.all(np.isinf(losses))


def test_the_same_flight_twice():
    flown = scenario(
        state_noise="reference",
        seed=3,
        disturbances=DisturbancesConfig(thrust_coefficient_error=0.1),
    )
    one, _ = fly(flown, hover(8.0), 0.3)
    other, _ = fly(flown, hover(8.0), 0.3)
    np.testing.assert_array_equal(one, other)
    assert np.any(fly(scenario(), hover(8.0), 0.3)[0] != one)


@both_drones
@pytest.mark.parametrize("noise", ["none", "reference"])
def test_it_recovers_from_upside_down(drone, noise):
    R = RollPitchYaw(np.pi, 0.0, 1.0).ToRotationMatrix()
    states, losses = fly(scenario(drone, state_noise=noise), hover(20.0), 2.5, R)
    assert states[:, 6].min() > 18.5  # m
    assert np.rad2deg(max(tilt(state) for state in states[-20:])) < 2.0
    assert errors(states, hover(20.0))[-1] < 0.05
    assert np.linalg.norm(states[-1, 10:]) < 0.2
    assert np.all(np.isinf(losses))


@both_drones
def test_it_follows_a_lap(drone):
    reference = lap()
    states, _ = fly(scenario(drone), reference, 4.0)
    assert np.sqrt(np.mean(errors(states, reference) ** 2)) < 0.02
    assert np.linalg.norm(states[:, 10:], axis=1).max() > 10.0  # m/s


def test_the_feed_forward_is_why():
    reference = lap()
    without = scenario(controller=ControllerConfig(feed_forward=False))
    states, _ = fly(without, reference, 3.0)
    assert np.sqrt(np.mean(errors(states, reference) ** 2)) > 0.04


AIR = {
    "wind": DisturbancesConfig(drag=1.0, wind=WindConfig(mean=[5.0, -3.0, 0.0])),
    "mass": DisturbancesConfig(mass_error=0.2),
}


@both_drones
@pytest.mark.parametrize("disturbances", AIR.values(), ids=AIR)
def test_what_pushes_it_does_not_move_it(drone, disturbances):
    """Not for long; without disturbance rejection it stays away."""
    end = {}
    for rejection in (True, False):
        config = ControllerConfig(disturbance_rejection=rejection)
        flown = scenario(drone, disturbances=disturbances, controller=config)
        states, _ = fly(flown, hover(8.0), 3.0, LEVEL)
        end[rejection] = errors(states, hover(8.0))[-1]
    assert end[True] < 0.01
    assert end[False] > 10 * end[True]


@pytest.mark.parametrize("rotor", [1, 2, 3, 4])
def test_a_quadrotor_without_a_rotor_comes_down_softly(rotor):
    flown = scenario(rotor_failures=[RotorFailure(rotor, 0.3)])
    states, losses = fly(flown, hover(2.0), 12.0, until=lambda state: state[6] < 0.15)
    assert states[-1, 6] < 0.15
    assert np.linalg.norm(states[-1, 10:]) < 1.0  # m/s
    assert np.rad2deg(tilt(states[-1])) < 20.0
    assert 0.3 < losses[rotor - 1] <= 0.32
    assert np.count_nonzero(np.isfinite(losses)) == 1
    # On the way it never tips over, nor does it drift far.
    assert np.rad2deg(max(tilt(state) for state in states)) < 90.0
    assert np.linalg.norm(states[:, 4:6], axis=1).max() < 5.0


def test_the_spin_settles_on_a_long_way_down():
    """Without drag nothing stops it but the rotor opposite the lost one."""
    flown = scenario(rotor_failures=[RotorFailure(3, 0.3)])
    states, _ = fly(flown, hover(14.0), 40.0, until=lambda state: state[6] < 0.15)
    assert states[-1, 6] < 0.15 and np.linalg.norm(states[-1, 10:]) < 1.0
    spins = np.abs(states[:, 9])  # about the vertical
    assert spins[-1] > 30.0 and spins.max() < 45.0


def test_it_comes_down_from_a_lap_as_well():
    """When the rotor stops, it is fast and leans into a bend."""
    flown = scenario(rotor_failures=[RotorFailure(2, 3.0)], state_noise="reference")
    states, _ = fly(flown, lap(), 15.0, until=lambda state: state[6] < 0.15)
    assert np.linalg.norm(states[round(3.0 / STEP), 10:]) > 15.0
    assert states[-1, 6] < 0.15 and np.linalg.norm(states[-1, 10:]) < 1.0


@pytest.mark.parametrize("rotor", [1, 4, 6, 7])
def test_the_star_one_stays_without_a_rotor(rotor):
    flown = scenario("StarOne", rotor_failures=[RotorFailure(rotor, 0.3)])
    states, losses = fly(flown, hover(8.0), 1.5)
    assert errors(states, hover(8.0)).max() < 0.05
    assert 0.3 < losses[rotor - 1] <= 0.32
    assert np.count_nonzero(np.isfinite(losses)) == 1


def test_the_star_one_flies_on_along_a_lap():
    reference = lap()
    flown = scenario("StarOne", rotor_failures=[RotorFailure(3, 1.0)])
    states, _ = fly(flown, reference, 3.0)
    assert errors(states, reference).max() < 0.05
