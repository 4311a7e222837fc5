"""A ball that flies through scenery, and feels what it touches."""

from collections.abc import Callable

import numpy as np
from pydrake.geometry import Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder


class BallWorld:
    """A ball in a world.

    Attributes:
        plant, scene_graph, diagram: of Drake.
    """

    def __init__(self, radius: float, add: Callable[[MultibodyPlant], object]):
        """Args: radius: of the ball (m). add: puts into the plant what else there is."""
        builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=1e-3)
        add(self.plant)
        inertia = SpatialInertia.SolidSphereWithMass(1.0, radius)
        self._ball = self.plant.AddRigidBody("ball", inertia)
        self.plant.RegisterCollisionGeometry(
            self._ball, RigidTransform(), Sphere(radius), "ball", CoulombFriction(0.5, 0.5)
        )
        self.plant.Finalize()
        self.diagram = builder.Build()

    def fly(self, start, velocity, duration):
        """Returns the names touched on the way and the way's end."""
        simulator = Simulator(self.diagram)
        context = self.plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        self.plant.SetFreeBodyPose(context, self._ball, RigidTransform(start))
        self.plant.SetFreeBodySpatialVelocity(
            context, self._ball, SpatialVelocity(np.zeros(3), velocity)
        )
        inspector, touched = self.scene_graph.model_inspector(), set()

        def look(_):
            results = self.plant.get_contact_results_output_port().Eval(context)
            for i in range(results.num_point_pair_contacts()):
                pair = results.point_pair_contact_info(i).point_pair()
                touched.update(inspector.GetName(each) for each in (pair.id_A, pair.id_B))

        simulator.set_monitor(look)
        simulator.AdvanceTo(duration)
        return touched - {"ball"}, self.plant.GetFreeBodyPose(context, self._ball).translation()
