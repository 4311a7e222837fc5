import cv2
import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator

from airrace.recording.foxglove_messages import raw_pixels
from airrace.systems.sensing.camera_view import CameraView
from airrace.systems.types import Detection, Detections, make_camera_info
from airrace.vehicle import load_vehicle
from airrace.visualization import camera_inset
from airrace.visualization.camera_inset import RAYS, CameraInset, inset_picture
from airrace.visualization.meshcat_page import HUD
from tests.visualization.meshcat_tools import Watching, drawn, fix

STATE = np.array([1.0, 0, 0, 0, 0, 0, 3.0, *6 * [0.0]])
PICTURE = np.random.default_rng(0).integers(0, 255, (720, 1280), np.uint8)


@pytest.fixture
def info():
    X_BC = load_vehicle("Default")[0].camera.X_BC
    return make_camera_info(width=1280, height=720, fov_y=1.0, X_BC=X_BC)


@pytest.fixture
def run(meshcat, info):
    """Shows one moment, with a picture that was taken at 0.1 s."""

    def run(detections, watching=True):
        inset = CameraInset(meshcat=meshcat, body_path="body", audience=Watching(watching))
        simulator = Simulator(inset)
        fix(
            inset,
            simulator.get_mutable_context(),
            truth__state=STATE,
            camera_view=CameraView.of(PICTURE),
            camera_image_time=[0.1],
            camera_info=info,
            detections=detections,
        )
        simulator.AdvanceTo(0.15)

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


def test_it_is_the_very_picture_that_the_detector_is_given(run, info, monkeypatch):
    shown = []
    monkeypatch.setattr(
        camera_inset.FixedPicture, "show", lambda self, picture: shown.append(picture)
    )
    run(Detections(time=0.1))
    small = cv2.resize(PICTURE, (320, 180), interpolation=cv2.INTER_AREA)
    np.testing.assert_array_equal(shown[-1], np.repeat(small[..., None], 3, axis=2))


def test_markers_of_another_picture_are_not_framed(run, monkeypatch):
    framed = []
    monkeypatch.setattr(
        camera_inset,
        "inset_picture",
        lambda picture, markers, info: framed.append(markers) or np.zeros((9, 16, 3), np.uint8),
    )
    run(_seen(RigidTransform([0, 0, 10.0])))
    run(_seen(RigidTransform([0, 0, 10.0]), time=0.1 - 1 / 30))
    assert [len(markers) for markers in framed] == [1, 1, 0, 0]  # twice each


@pytest.mark.parametrize("k1", [0.0, -0.2])
def test_the_markers_are_framed(info, k1):
    """Where they are in what the camera took, through a lens that distorts, too."""
    info = make_camera_info(
        width=1280, height=720, fov_y=1.0, X_BC=info.X_BC, D=[k1, 0.0, 0.0, 0.0, 0.0]
    )
    markers = _seen(RigidTransform()).markers
    image = inset_picture(np.zeros((720, 1280), np.uint8), markers, info)
    # Half way along the upper edge. Without distortion that is (112, 75) of a quarter.
    u, v = ((raw_pixels(markers[0].corners, info) + 0.5) / 4 - 0.5)[:2].mean(axis=0).round()
    assert (k1 == 0.0) == ((u, v) == (112.0, 75.0))
    assert image[int(v), int(u), 1] > 150 and image[int(v), int(u), 0] < 150


def test_the_frustum_ends_at_the_corners_of_the_picture(meshcat, run, info):
    run(Detections())
    array = drawn(meshcat, "body/frustum")["object"]["geometries"][0]["data"]["attributes"]
    points = np.frombuffer(array["position"]["array"], np.float32).reshape(-1, 3)
    u, v, w = info.K @ points[1]
    np.testing.assert_allclose([u / w, v / w], [-0.5, -0.5], atol=1e-3)
