import numpy as np
import pytest
from pydrake.math import RotationMatrix
from pydrake.systems.analysis import Simulator

from airrace.vehicle import load_vehicle
from airrace.visualization.views import BUTTONS, CHASE, ONBOARD, OVERVIEW, ViewDirector
from tests.visualization.meshcat_tools import click, fix, property_of

_CAMERA = "/Cameras/default/rotated/<object>"


@pytest.fixture
def director(meshcat):
    return ViewDirector(
        meshcat=meshcat,
        overview=(np.array([0.0, -50, 30]), np.zeros(3)),
        body_path="body",
        X_BC=load_vehicle("Default")[0].camera.X_BC,
    )


@pytest.fixture
def simulator(director):
    simulator = Simulator(director)
    state = [1.0, 0, 0, 0, 5.0, 6.0, 7.0, *6 * [0.0]]  # looks along x
    fix(director, simulator.get_mutable_context(), truth__state=state)
    return simulator


def _eye(meshcat):
    """Where the page's camera is, in world."""
    x, y, z = property_of(meshcat, _CAMERA, "position")
    return np.array([x, -z, y])


def test_from_above_the_camera_is_the_mouses(meshcat, simulator):
    meshcat.SetCameraPose(np.array([1.0, 2.0, 3.0]), np.zeros(3))
    simulator.AdvanceTo(0.2)
    np.testing.assert_allclose(_eye(meshcat), [1.0, 2.0, 3.0])


def test_buttons_change_the_view(meshcat, simulator):
    click(meshcat, BUTTONS[CHASE][0])
    simulator.AdvanceTo(0.1)
    eye = _eye(meshcat)
    assert eye[0] < 1.0 and eye[1] == pytest.approx(6.0) and eye[2] > 8.0
    assert property_of(meshcat, "here", "visible") is False
    assert property_of(meshcat, "body", "visible") is True

    click(meshcat, BUTTONS[ONBOARD][0])
    simulator.AdvanceTo(0.2)
    np.testing.assert_allclose(_eye(meshcat), [5.0, 6.0, 7.0], atol=1e-9)
    assert property_of(meshcat, "body", "visible") is False

    click(meshcat, BUTTONS[OVERVIEW][0])
    simulator.AdvanceTo(0.3)
    np.testing.assert_allclose(_eye(meshcat), [0.0, -50, 30])
    assert property_of(meshcat, "here", "visible") is True
    assert property_of(meshcat, "body", "visible") is True


def test_the_chasing_camera_turns_later_than_the_drone(meshcat, director, simulator):
    click(meshcat, BUTTONS[CHASE][0])
    simulator.AdvanceTo(0.1)
    q = RotationMatrix.MakeZRotation(np.pi / 2).ToQuaternion().wxyz()
    state = [*q, 5.0, 6.0, 7.0, *6 * [0.0]]  # looks along y now
    fix(director, simulator.get_mutable_context(), truth__state=state)
    simulator.AdvanceTo(0.15)
    assert _eye(meshcat)[0] < 1.0
    simulator.AdvanceTo(4.0)
    np.testing.assert_allclose(_eye(meshcat)[:2], [5.0, 1.0], atol=0.1)


def test_the_end_leaves_who_looks_from_above_alone(meshcat, director, simulator):
    meshcat.SetCameraPose(np.array([1.0, 2.0, 3.0]), np.zeros(3))
    director.end()
    np.testing.assert_allclose(_eye(meshcat), [1.0, 2.0, 3.0])
    click(meshcat, BUTTONS[ONBOARD][0])
    simulator.AdvanceTo(0.1)
    director.end()
    np.testing.assert_allclose(_eye(meshcat), [0.0, -50, 30])
