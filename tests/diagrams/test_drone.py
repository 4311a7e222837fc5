"""A drone is a unit: a second one in the same world flies, sees and is judged on its own."""

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from airrace.diagrams.drone import AddDrone, PlaceDrone
from airrace.diagrams.world import AddWorld
from airrace.scenario import Scenario
from airrace.scenario.camera_config import CameraConfig
from airrace.systems.plant.multirotor import ApplyForces
from airrace.systems.types import ExplorerStatus
from airrace.track import Start
from airrace.vehicle import load_vehicle
from airrace.vehicle.state import as_plant_state, as_state

SUFFIXES = ("", "_blue")
VEHICLE, _ = load_vehicle("Default")


def make(starts, shares):
    """Returns the diagram of drones with constant shares of all thrust, and its simulator."""
    builder = DiagramBuilder()
    world = AddWorld(builder, Scenario(camera=CameraConfig(preset="clean")))
    drones = [PlaceDrone(world, start, suffix) for start, suffix in zip(starts, SUFFIXES)]
    world.plant.Finalize()
    forces = [port for drone in drones for port in AddDrone(builder, world, drone)]
    ApplyForces(builder, world.plant, forces)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    for drone, share in zip(drones, shares):
        status = diagram.GetInputPort("explorer_status" + drone.suffix)
        status.FixValue(context, Value[object](ExplorerStatus(done=True)))
        command = diagram.GetInputPort("rotor_speed_command" + drone.suffix)
        command.FixValue(context, np.sqrt(share) * VEHICLE.max_speeds)
    simulator.Initialize()
    return diagram, simulator


def fly(starts, shares):
    """Flies drones for 0.1 s; returns the diagram and its context."""
    diagram, simulator = make(starts, shares)
    simulator.AdvanceTo(0.1)
    return diagram, simulator.get_context()


def outputs(flight, name):
    diagram, context = flight
    return [diagram.GetOutputPort(name + suffix).Eval(context) for suffix in SUFFIXES]


def test_two_drones_fly_in_one_world():
    starts = [Start([0.0, 0.0, 0.0], 0.0), Start([0.0, 3.0, 0.0], 90.0)]
    flight = fly(starts, shares=(0.0, 1.0))
    stands, flies = map(as_plant_state, outputs(flight, "truth.state"))
    np.testing.assert_allclose(stands.position, [0.0, 0.0, 0.1], atol=1e-3)
    np.testing.assert_allclose(flies.position[:2], [0.0, 3.0], atol=1e-6)
    assert flies.velocity[2] > 0.3 and abs(stands.velocity[2]) < 1e-3
    heading = 2.0 * np.arctan2(flies.quaternion[3], flies.quaternion[0])
    assert heading == pytest.approx(np.pi / 2)
    speeds = outputs(flight, "rotor_speeds")
    assert not speeds[0].any() and np.all(speeds[1] > 0.0)
    assert [report.over for report in outputs(flight, "truth.referee_status")] == [False, False]
    estimates = outputs(flight, "state_estimate")
    assert as_state(estimates[1]).position[1] == pytest.approx(3.0, abs=0.1)
    pictures = [image.data.copy() for image in outputs(flight, "camera_grey")]
    assert (pictures[0] != pictures[1]).mean() > 0.2


def test_the_second_flies_as_if_it_were_the_only_one():
    starts = [Start([0.0, 0.0, 0.0], 0.0), Start([0.0, 3.0, 0.0], 90.0)]
    together = outputs(fly(starts, shares=(0.5, 0.9)), "truth.state")[1]
    diagram, context = fly(starts[1:], shares=(0.9,))
    alone = diagram.GetOutputPort("truth.state").Eval(context)
    np.testing.assert_allclose(together, alone, atol=1e-12)


def test_each_is_judged_on_its_own():
    starts = [Start([0.0, 0.0, 0.0], 0.0), Start([0.0, 3.0, 0.0], 90.0)]
    diagram, simulator = make(starts, shares=(0.0, 0.5))
    simulator.AdvanceTo(0.5)
    context = simulator.get_mutable_context()
    diagram.GetInputPort("rotor_speed_command_blue").FixValue(context, np.zeros(4))
    simulator.AdvanceTo(2.5)
    stands, crashed = outputs((diagram, context), "truth.referee_status")
    assert not stands.over
    assert crashed.dnf_reason == "hit the ground" and crashed.collisions == 1
