"""A view shows the same pixels whatever is asked for first."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.eigen_geometry import Quaternion
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RollPitchYaw

from airrace.rendering.imaging.camera_effects import ImagingChain
from airrace.rendering.planar.renderer import PlanarRenderer
from airrace.scenario.camera_config import PRESETS
from airrace.systems.perception.rectifier import Rectifier
from airrace.systems.sensing.camera import Camera
from airrace.systems.sensing.camera_view import CameraView
from airrace.track import load_track
from airrace.vehicle.camera_info import make_camera_info
from tests.worlds.pictures import CAMERA_INFO

TRACK = load_track("student-airrace")
FPS = 30.0
BOXES = [(600, 300, 700, 380), (0, 0, 1, 1), (1279, 719, 1280, 720), (100, 0, 1000, 400)]


def look(preset, w_WB=(0.3, -0.5, 1.0), size=(1280, 720)):
    """Returns grey picture and view of one sample, in two contexts, and the info."""
    effects = PRESETS[preset]
    info = make_camera_info(
        width=size[0],
        height=size[1],
        fov_y=np.deg2rad(55.95),
        X_BC=CAMERA_INFO.X_BC,
        D=effects.distortion,
    )
    imaging = ImagingChain(effects=effects, camera_info=info, seed=0)
    camera = Camera(
        camera_info=info, fps=FPS, imaging=imaging, renderer=PlanarRenderer(TRACK, imaging.pinhole)
    )
    values = []
    for name in ("camera_grey", "camera_view"):
        context = camera.CreateDefaultContext()
        X_WB = RigidTransform(RollPitchYaw(0.1, 0.1, 0.2), [7.0, 1.0, 5.0])
        q: Quaternion = X_WB.rotation().ToQuaternion()
        state = [*q.wxyz(), *X_WB.translation(), *w_WB, 6.0, 1.0, -1.0]
        camera.GetInputPort("state").FixValue(context, state)
        camera.CalcForcedUnrestrictedUpdate(context, context.get_mutable_state())
        values.append(camera.GetOutputPort(name).Eval(context))
    return values[0].data[..., 0].copy(), values[1], info


@pytest.mark.parametrize(
    "preset, w_WB, size",
    [
        ("clean", (0, 0, 0), (1280, 720)),
        ("realistic", (0.3, -0.5, 1.0), (1280, 720)),
        ("realistic", (0.3, -0.5, 8.0), (1280, 720)),
        ("harsh", (0.3, -0.5, 1.0), (1280, 720)),
        ("realistic", (0.3, -0.5, 1.0), (333, 501)),
    ],
)
def test_regions_are_those_of_the_whole_picture(preset, w_WB, size):
    picture, view, _ = look(preset, w_WB, size)
    assert view.shape == picture.shape
    w, h = size
    for x0, y0, x1, y1 in BOXES:
        x0, y0, x1, y1 = min(x0, w - 1), min(y0, h - 1), min(x1, w), min(y1, h)
        assert np.array_equal(view.region(x0, y0, x1, y1), picture[y0:y1, x0:x1])
        drawn = view.drawn((x0, y0, x1, y1), (0, 0, x0, y1), (x0, y0, w, y1))
        assert np.array_equal(drawn[y0:y1], picture[y0:y1])
    assert np.array_equal(view.whole(), picture)


def test_rectified_regions_are_those_of_the_whole_picture():
    picture, view, info = look("harsh")
    rectifier = Rectifier()
    context = rectifier.CreateDefaultContext()
    rectifier.GetInputPort("camera_info").FixValue(context, Value[object](info))
    port = rectifier.GetInputPort("camera_view")
    port.FixValue(context, Value[object](CameraView.of(picture)))
    whole = rectifier.GetOutputPort("camera_view").Eval(context).whole().copy()
    port.FixValue(context, Value[object](view))
    rectified = rectifier.GetOutputPort("camera_view").Eval(context)
    for x0, y0, x1, y1 in BOXES:
        assert np.array_equal(rectified.region(x0, y0, x1, y1), whole[y0:y1, x0:x1])
    assert np.array_equal(rectified.whole(), whole)


def test_nothing_is_drawn_twice_or_in_vain():
    def draw(out, boxes):
        for x0, y0, x1, y1 in boxes:
            times[y0:y1, x0:x1] += 1
            out[y0:y1, x0:x1] = 7
        calls.append(boxes.tolist())

    view, times, calls = CameraView((100, 200), draw), np.zeros((100, 200)), []
    assert np.all(view.region(70, 10, 80, 20) == 7)
    assert calls == [[[64, 0, 80, 24]]]
    view.region(64, 0, 80, 24)
    assert len(calls) == 1
    view.region(70, 10, 130, 20)
    assert calls[1:] == [[[80, 0, 144, 24]]]
    view.region(60, 20, 90, 40)
    assert calls[2:] == [[[48, 12, 64, 48], [64, 24, 96, 48]]]
    assert np.all(view.whole() == 7) and np.all(times == 1)
    view.whole()
    assert len(calls) == 4


regions = st.lists(
    st.tuples(st.integers(-9, 210), st.integers(-9, 110), st.integers(0, 210), st.integers(0, 110)),
    max_size=6,
)


@given(st.lists(regions, max_size=3))
def test_any_regions_are_drawn_once(lots):
    times, asked, calls = np.zeros((100, 200)), np.zeros((100, 200), bool), []

    def draw(out, boxes):
        for x0, y0, x1, y1 in boxes:
            times[y0:y1, x0:x1] += 1
        calls.append(boxes)

    view = CameraView((100, 200), draw)
    for lot in lots:
        view.drawn(*((x, y, x + w, y + h) for x, y, w, h in lot))
        for x, y, w, h in lot:  # as far as it is in the picture
            asked[max(y, 0) : max(y + h, 0), max(x, 0) : max(x + w, 0)] = True
        assert np.all(times[asked] == 1) and times.max() <= 1
    assert len(calls) <= sum(map(bool, lots))  # all of a lot at once
    # No more than the tiles that they touch.
    near = cv2.dilate(asked.astype(np.uint8), np.ones((2 * 12 - 1, 2 * 16 - 1))) > 0
    assert not times[~near].any()


def test_a_view_of_a_picture():
    picture = np.arange(12, dtype=np.uint8).reshape(3, 4)
    view = CameraView.of(picture)
    assert view.shape == (3, 4) and view.whole() is picture
    assert np.array_equal(view.region(1, 0, 3, 2), picture[:2, 1:3])
