import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.geometry import Rgba, Role
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from airrace.rendering.scene.pad import AddPad, pad_rotation, start_pose
from airrace.track import Start


def start(tilt_deg, direction_deg=0.0, heading_deg=30.0):
    return Start([3.0, 4.0, 0.0], heading_deg, tilt_deg, direction_deg)


@given(st.floats(0, 15), st.floats(-360, 360))
def test_the_pad_descends_in_its_direction(tilt_deg, direction_deg):
    R = pad_rotation(start(tilt_deg, direction_deg))
    normal = R.matrix()[:, 2]
    assert normal[2] == pytest.approx(np.cos(np.deg2rad(tilt_deg)))
    downhill = np.array([np.cos(np.deg2rad(direction_deg)), np.sin(np.deg2rad(direction_deg)), 0])
    slope = R.matrix() @ downhill
    np.testing.assert_allclose(slope[2], -np.sin(np.deg2rad(tilt_deg)), atol=1e-12)
    np.testing.assert_allclose(normal[:2], np.sin(np.deg2rad(tilt_deg)) * downhill[:2], atol=1e-12)


def test_a_level_start_stands_on_the_ground():
    X_WB = start_pose(start(0.0), 0.4, 0.1)
    np.testing.assert_allclose(X_WB.translation(), [3.0, 4.0, 0.1])
    R = X_WB.rotation().matrix()
    np.testing.assert_allclose(R[:, 0], [np.cos(np.pi / 6), 0.5, 0.0], atol=1e-12)


def geometries(tilt_deg):
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=1e-3)
    AddPad(plant, start(tilt_deg, 40.0), 0.4)
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


def test_the_drone_stands_on_the_middle_of_the_slope():
    """The normal through the drone's origin meets the slope at its middle."""
    place = start(10.0, 40.0)
    X_WB = start_pose(place, 0.4, 0.1)
    foot = X_WB.translation() - 0.1 * X_WB.rotation().col(2)
    np.testing.assert_allclose(foot[:2], place.position[:2])
    assert foot[2] == pytest.approx(0.02 + 0.6 * np.sin(np.deg2rad(10.0)))
