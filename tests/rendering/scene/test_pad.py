import numpy as np
from pydrake.geometry import Rgba, Role
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from airrace.rendering.scene.scenery import AddPad
from airrace.track import Start


def geometries(tilt_deg):
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=1e-3)
    AddPad(plant, Start([3.0, 4.0, 0.0], 30.0, tilt_deg, 40.0), 0.4)
    plant.Finalize()
    inspector = scene_graph.model_inspector()
    return inspector, {
        role: inspector.GetGeometries(scene_graph.world_frame_id(), role)
        for role in (Role.kProximity, Role.kIllustration, Role.kPerception)
    }


def test_there_is_no_pad_where_it_is_level():
    assert not any(geometries(0.0)[1].values())


def test_it_can_be_hit_and_is_drawn_but_not_for_the_camera():
    inspector, found = geometries(10.0)
    assert [len(found[role]) for role in found] == [1, 1, 0]
    assert inspector.GetName(found[Role.kProximity][0]).endswith("pad")
    box = inspector.GetObbInGeometryFrame(found[Role.kProximity][0])
    lowest = (
        box.pose().translation()[2] - np.abs(box.pose().rotation().matrix()[2]) @ box.half_width()
    )
    assert lowest < 0.05  # it stands on the ground


def test_a_pad_is_drawn_in_its_colour():
    """Drake draws nothing, and raises, for a colour of another type than its own."""
    inspector, found = geometries(10.0)
    properties = inspector.GetIllustrationProperties(found[Role.kIllustration][0])
    assert isinstance(properties.GetProperty("phong", "diffuse"), Rgba)
