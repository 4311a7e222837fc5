"""What a drone of the batch touches, against Drake's geometry."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from airrace.common.errors import UserError
from airrace.common.jit import compiled
from airrace.envs.batch.contact import is_near_something, load_shape, touches_gate, touches_ground
from airrace.envs.batch.courses import make_courses
from airrace.rendering.scene.scenery import AddScenery
from airrace.systems.plant.multirotor import AddMultirotorModel
from airrace.track import load_track
from airrace.vehicle import RACERS, load_vehicle
from airrace.vehicle.free_body import Motion

TRACK = load_track("hexagon")
UNSURE = 0.005  # m, within which the nearest facet's plane is taken for the facet
CLEARANCE, WIDE_UNSURE = 0.4, 0.1  # m, the latter beside an edge, where planes are nearer


class World:
    """A drone among the obstacles of a track, for Drake and for the batch."""

    def __init__(self, name):
        vehicle, sdf = load_vehicle(name)
        builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(builder, 0.001)
        AddScenery(self.plant, TRACK, visible=False)
        AddMultirotorModel(self.plant, vehicle, sdf)
        self.plant.Finalize()
        self.diagram = builder.Build()
        self.context = self.diagram.CreateDefaultContext()
        self.shape = load_shape(vehicle, sdf)
        self.wide_shape = load_shape(vehicle, sdf, clearance=CLEARANCE)
        self.courses = make_courses(
            [TRACK],
            laps=1,
            arena_margin=60.0,
            radius=vehicle.radius,
            standing_height=self.shape.standing_height,
        )

    def distances(self, quaternion, position):
        """Returns the drone's distances from the ground and from everything else (m)."""
        plant = self.plant
        X_WB = RigidTransform(Quaternion(quaternion), position)
        context = plant.GetMyMutableContextFromRoot(self.context)
        plant.SetFloatingBaseBodyPoseInWorldFrame(context, plant.GetBodyByName("body"), X_WB)
        query = self.scene_graph.get_query_output_port().Eval(
            self.scene_graph.GetMyContextFromRoot(self.context)
        )
        inspector, ground, others = self.scene_graph.model_inspector(), np.inf, np.inf
        for pair in query.ComputeSignedDistancePairwiseClosestPoints(3.0):
            names = inspector.GetName(pair.id_A), inspector.GetName(pair.id_B)
            if any(name.endswith("ground") for name in names):
                ground = min(ground, pair.distance)
            else:
                others = min(others, pair.distance)
        return ground, others


WORLDS = {name: World(name) for name in RACERS}


@compiled
def touched(motion, shape, courses, margin):
    return (
        touches_ground(motion, shape),
        touches_gate(motion, shape, 0, courses),
        is_near_something(motion.position, margin + shape.reach, 0, courses),
    )


@pytest.mark.parametrize("name", RACERS)
@settings(max_examples=150, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_what_is_touched_is_what_drake_says(name, seed):
    """Around a pylon and its boards, in any attitude."""
    world, generator = WORLDS[name], np.random.default_rng(seed)
    quaternion = generator.standard_normal(4)
    quaternion /= np.linalg.norm(quaternion)
    foot = TRACK.pylons()[generator.integers(2 * len(TRACK.gates))]
    height = generator.choice([0.3, 3.0, 6.25, 12.0])
    position = foot + [0.0, 0.0, height] + generator.uniform(-2.5, 2.5, 3)
    position[2] = abs(position[2])  # nobody flies below the ground
    still = (0.0, 0.0, 0.0)
    motion = Motion(tuple(quaternion), tuple(position), still, still)
    ground, others = world.distances(quaternion, position)
    on_ground, on_gate, near = touched(motion, world.shape, world.courses, 0.1)
    on_ground_too, near_gate, _ = touched(motion, world.wide_shape, world.courses, 0.1)
    assert on_ground == (ground < 0.0) and on_ground_too == (ground < CLEARANCE)
    if others < CLEARANCE:
        assert near_gate
    elif others > CLEARANCE + WIDE_UNSURE:
        assert not near_gate
    if abs(others) > UNSURE:
        assert on_gate == (others < 0.0)
    if min(ground, others) < 0.1:
        assert near


def test_a_drone_that_is_not_made_of_spheres_is_refused(tmp_path):
    vehicle, sdf = load_vehicle("Default")
    text = sdf.read_text().replace(
        "<sphere><radius>0.1</radius></sphere>", "<box><size>0.2 0.2 0.1</size></box>", 1
    )
    (tmp_path / "boxes.sdf").write_text(text)
    with pytest.raises(UserError, match="is no sphere"):
        load_shape(vehicle, tmp_path / "boxes.sdf")
