import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator

from airrace.rendering.planar.renderer import PlanarRenderer
from airrace.systems.types import Detection, Detections, make_camera_info
from airrace.track import load_track
from airrace.vehicle import load_vehicle
from airrace.visualization.camera_inset import RAYS, CameraInset
from airrace.visualization.meshcat_page import HUD
from tests.visualization.meshcat_tools import Watching, drawn, fix

STATE = np.array([1.0, 0, 0, 0, 0, 0, 3.0, *6 * [0.0]])


@pytest.fixture
def info():
    X_BC = load_vehicle("Default")[0].camera.X_BC
    return make_camera_info(width=320, height=180, fov_y=1.0, X_BC=X_BC)


@pytest.fixture
def run(meshcat, info):
    """Shows one moment."""

    def run(detections, watching=True):
        inset = CameraInset(
            meshcat=meshcat,
            small=info,
            scale=0.25,
            body_path="body",
            renderer=PlanarRenderer(load_track("student-airrace"), info),
            audience=Watching(watching),
        )
        simulator = Simulator(inset)
        fix(inset, simulator.get_mutable_context(), truth__state=STATE, detections=detections)
        simulator.AdvanceTo(0.15)
        return inset

    return run


def _seen(X_CM, time=0.1):
    corners = np.array([[400.0, 300], [500, 300], [500, 400], [400, 400]])
    return Detections(time=time, markers=(Detection(4, corners, X_CM, 0.1),))


def test_nothing_but_the_frustum_if_nobody_watches(meshcat, run):
    run(_seen(RigidTransform([0, 0, 10.0])), watching=False)
    assert meshcat.HasPath("body/frustum")
    assert not meshcat.HasPath(HUD) and not meshcat.HasPath(RAYS)


def test_shows_a_picture_and_rays(meshcat, run):
    run(_seen(RigidTransform([0, 0, 10.0])))
    assert meshcat.HasPath(f"{HUD}/camera/0")
    array = drawn(meshcat, RAYS)["object"]["geometries"][0]["data"]["attributes"]["position"]
    points = np.frombuffer(array["array"], np.float32).reshape(-1, 3)
    # Straight ahead of the camera is along x of a drone that looks that way.
    np.testing.assert_allclose(points, [[0, 0, 3], [10, 0, 3]], atol=1e-5)


def test_rays_go_when_nothing_is_seen_or_it_is_old(meshcat, run):
    run(Detections(time=0.1))
    assert not meshcat.HasPath(RAYS)
    run(_seen(RigidTransform([0, 0, 10.0]), time=-0.2))
    assert not meshcat.HasPath(RAYS)


def test_the_markers_are_framed(run):
    inset = run(_seen(RigidTransform([0, 0, 10.0])))
    image = inset._marked(_seen(RigidTransform()).markers)
    # The corner (400, 300) is at (99.6, 74.6) in a picture of a quarter of the pixels.
    assert image[75, 112, 1] > 150 and image[75, 112, 0] < 150


def test_the_frustum_ends_at_the_corners_of_the_picture(meshcat, run, info):
    run(Detections())
    array = drawn(meshcat, "body/frustum")["object"]["geometries"][0]["data"]["attributes"]
    points = np.frombuffer(array["position"]["array"], np.float32).reshape(-1, 3)
    u, v, w = info.K @ points[1]
    np.testing.assert_allclose([u / w, v / w], [-0.5, -0.5], atol=1e-4)
