import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.systems.sensors import ImageRgba8U

from airrace.systems.aruco_detector import ArucoDetector, locate
from airrace.systems.types import make_camera_info
from airrace.track import MARKER_SIZE

INFO = make_camera_info(width=1280, height=720, fov_y=np.deg2rad(55.95), X_BC=RigidTransform())
FACING = RotationMatrix(np.diag([1.0, -1.0, -1.0]))  # a marker that faces the camera
H = MARKER_SIZE / 2
CORNERS = np.array([[-H, H, 0], [H, H, 0], [H, -H, 0], [-H, -H, 0]])


def project(X_CM):
    p = X_CM.multiply(CORNERS.T)
    uvw = INFO.K @ p
    return (uvw[:2] / uvw[2]).T


def picture(markers):
    """An image of markers {id: X_CM} on white boards before grey."""
    image = np.full((720, 1280), 120, np.uint8)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_ARUCO_ORIGINAL)
    for id, X_CM in markers.items():
        board = cv2.copyMakeBorder(
            cv2.aruco.generateImageMarker(dictionary, id, 560), 70, 70, 70, 70,
            cv2.BORDER_CONSTANT, value=255)
        source = np.float32([[69.5, 69.5], [629.5, 69.5], [629.5, 629.5], [69.5, 629.5]])
        homography = cv2.getPerspectiveTransform(source, np.float32(project(X_CM)))
        warped, mask = (
            cv2.warpPerspective(x, homography, (1280, 720))
            for x in (board, np.full_like(board, 255))
        )
        image[mask > 127] = warped[mask > 127]
    return image


def detect(grey, time=1.5):
    detector = ArucoDetector()
    context = detector.CreateDefaultContext()
    image = ImageRgba8U(grey.shape[1], grey.shape[0])
    image.mutable_data[:] = cv2.cvtColor(grey, cv2.COLOR_GRAY2RGBA)
    detector.GetInputPort("camera_image").FixValue(context, Value(image))
    detector.GetInputPort("camera_image_time").FixValue(context, [time])
    detector.GetInputPort("camera_info").FixValue(context, Value[object](INFO))
    return detector.get_output_port().Eval(context)


def test_finds_markers_and_their_poses():
    poses = {
        0: RigidTransform(FACING, [-3.0, 0.0, 10.0]),
        6: RigidTransform(RollPitchYaw(0.1, 0.5, 0).ToRotationMatrix() @ FACING, [2, -1, 8.0]),
        39: RigidTransform(FACING, [0.0, 0.5, 20.0]),
    }
    found = detect(picture(poses))
    assert found.time == 1.5
    assert {m.id for m in found.markers} == set(poses)
    for marker in found.markers:
        X_CM = poses[marker.id]
        distance = np.linalg.norm(X_CM.translation())
        np.testing.assert_allclose(
            marker.X_CM.translation(), X_CM.translation(), atol=0.03 * distance)
        np.testing.assert_allclose(marker.corners, project(X_CM), atol=1.5)
        assert marker.reprojection_error < 1.0


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_nothing_in_an_empty_image(grey):
    assert detect(np.full((720, 1280), grey, np.uint8)).markers == ()


def test_nothing_in_noise():
    noise = np.random.default_rng(0).integers(0, 256, (720, 1280), dtype=np.uint8)
    assert detect(noise).markers == ()


def test_the_image_is_searched_once(monkeypatch):
    detector = ArucoDetector()
    context = detector.CreateDefaultContext()
    calls = []

    class Counting:
        def detectMarkers(self, image):
            calls.append(image)
            return (), None, ()

    detector._detector = Counting()
    detector.GetInputPort("camera_image").FixValue(context, Value(ImageRgba8U(64, 64)))
    detector.GetInputPort("camera_image_time").FixValue(context, [0.0])
    detector.GetInputPort("camera_info").FixValue(context, Value[object](INFO))
    for _ in range(3):
        detector.get_output_port().Eval(context)
    context.SetTime(1.0)
    detector.get_output_port().Eval(context)
    assert len(calls) == 1


angles = st.floats(-0.9, 0.9)


@given(angles, angles, st.floats(-4, 4), st.floats(-2, 2), st.floats(6, 35))
def test_locate_inverts_the_projection(pitch, yaw, x, y, z):
    """From exact corners, the position is exact."""
    R = RollPitchYaw(pitch, yaw, 0.0).ToRotationMatrix() @ FACING
    X_CM = RigidTransform(R, [x, y, z])
    marker = locate(5, project(X_CM), INFO)
    np.testing.assert_allclose(marker.X_CM.translation(), X_CM.translation(), atol=1e-5 * z)
    assert marker.X_CM.rotation().IsValid()


@pytest.mark.parametrize("yaw", [0.0, 0.3, -0.44])
@pytest.mark.parametrize("x", [0.0, 1.0, -3.3])
def test_locate_in_views_of_perfect_symmetry(yaw, x):
    """OpenCV's closed form fails in some of them."""
    R = RollPitchYaw(0.0, yaw, 0.0).ToRotationMatrix() @ FACING
    for z in np.linspace(6.0, 35.0, 200):
        X_CM = RigidTransform(R, [x, 0.0, z])
        marker = locate(5, project(X_CM), INFO)
        np.testing.assert_allclose(marker.X_CM.translation(), X_CM.translation(), atol=1e-5 * z)


@pytest.mark.parametrize("corners", [np.full((4, 2), np.nan), np.zeros((4, 2))])
def test_locate_refuses_what_is_no_square(corners):
    assert locate(5, corners, INFO) is None
