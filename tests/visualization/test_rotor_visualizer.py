import numpy as np
import pytest
from pydrake.geometry import MeshcatVisualizer
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from airrace.recording.race_events import StateSample
from airrace.systems.plant.multirotor import AddMultirotorModel
from airrace.vehicle import DRONES, load_vehicle
from airrace.visualization.rotor_visualizer import (
    SLOW_MOTION,
    RotorVisualizer,
    body_path,
    find_blades,
)
from tests.visualization.meshcat_tools import Watching, transform


def _drone(name, meshcat=None):
    vehicle, sdf = load_vehicle(name)
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.001)
    AddMultirotorModel(plant, vehicle, sdf)
    plant.Finalize()
    if meshcat is not None:
        MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat)
        diagram = builder.Build()
        diagram.ForcedPublish(diagram.CreateDefaultContext())
    return vehicle, plant, scene_graph


@pytest.mark.parametrize("name", DRONES)
def test_every_rotor_of_a_shipped_drone_has_a_blade(name):
    vehicle, plant, scene_graph = _drone(name)
    blades = find_blades(plant, scene_graph, vehicle)
    assert sorted(rotor for rotor, _, _ in blades) == list(range(len(vehicle.rotors)))


def test_blades_are_where_the_scene_is_drawn(meshcat):
    vehicle, plant, scene_graph = _drone("Default", meshcat)
    for _, name, _ in find_blades(plant, scene_graph, vehicle):
        assert meshcat.HasPath(f"{body_path(plant)}/{name}")


def test_blades_turn_with_their_rotors_and_a_dead_one_stands_still(meshcat):
    vehicle, plant, scene_graph = _drone("Default", meshcat)
    blades = find_blades(plant, scene_graph, vehicle)
    path = body_path(plant)
    visualizer = RotorVisualizer(meshcat, vehicle, path, blades, Watching())
    before = [transform(meshcat, f"{path}/{name}") for _, name, _ in blades]
    speeds = np.array([50.0, 0.0, 50.0, 80.0])
    visualizer.take(StateSample(0.1, None, rotor_speeds=speeds))
    for (rotor, name, _), old in zip(blades, before):
        new = transform(meshcat, f"{path}/{name}")
        turn = np.arctan2(new[1], new[0]) - np.arctan2(old[1], old[0])
        sign = 1.0 if vehicle.rotors[rotor].direction == "ccw" else -1.0
        assert turn == pytest.approx(sign * SLOW_MOTION * 0.1 * speeds[rotor], abs=1e-6)
        np.testing.assert_allclose(new[12:], old[12:])
