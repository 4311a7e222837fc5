import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.geometry import Role
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from airrace.errors import UserError
from airrace.systems.multirotor import AddMultirotor, AddMultirotorModel
from airrace.vehicle import GRAVITY, load_vehicle

VEHICLE, SDF = load_vehicle("Default")
DT = 0.001


class Drone:
    """A drone in empty space."""

    def __init__(self):
        builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(builder, DT)
        AddMultirotorModel(self.plant, VEHICLE, SDF)
        self.plant.Finalize()
        self.rotors = AddMultirotor(builder, self.plant, self.scene_graph, VEHICLE)
        builder.ExportInput(self.rotors.GetInputPort("rotor_speed_command"), "command")
        self.diagram = builder.Build()


DRONE = Drone()


@settings(max_examples=30)
@given(st.lists(st.floats(0, 92), min_size=4, max_size=4))
def test_the_plant_feels_what_the_allocation_says(speeds):
    """One step from rest, against Newton and Euler."""
    simulator = Simulator(DRONE.diagram)
    context = simulator.get_mutable_context()
    DRONE.diagram.get_input_port().FixValue(context, speeds)
    DRONE.rotors.GetMyMutableContextFromRoot(context).SetDiscreteState(np.array(speeds))
    simulator.AdvanceTo(1.5 * DT)
    velocities = DRONE.plant.GetVelocities(DRONE.plant.GetMyContextFromRoot(context))
    f, *moment = VEHICLE.allocation @ (1e-3 * np.square(speeds))
    # The second step, at t = 1 ms, turns the thrust by less than is seen here.
    steps = 2
    np.testing.assert_allclose(
        velocities[:3], steps * DT * np.array(moment) / VEHICLE.inertia, atol=2e-3
    )
    np.testing.assert_allclose(velocities[3:5], 0, atol=1e-3)
    assert velocities[5] == pytest.approx(steps * DT * (f / VEHICLE.mass - GRAVITY), abs=1e-3)


def test_the_camera_does_not_see_its_own_drone():
    inspector = DRONE.scene_graph.model_inspector()
    frame = DRONE.plant.GetBodyFrameIdOrThrow(DRONE.plant.GetBodyByName("body").index())
    assert inspector.GetGeometries(frame, Role.kPerception) == []
    assert len(inspector.GetGeometries(frame, Role.kIllustration)) > 4


@pytest.mark.parametrize("change", [dict(mass=1.1), dict(inertia=[0.01, 0.011, 0.018])])
def test_a_model_that_contradicts_its_vehicle_is_refused(change):
    plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), DT)
    with pytest.raises(UserError, match="mass and inertia"):
        AddMultirotorModel(plant, dc.replace(VEHICLE, **change), SDF)
