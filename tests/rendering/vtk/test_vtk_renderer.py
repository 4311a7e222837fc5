"""The vtk renderer agrees with the planar one, and says when it cannot work."""

import ctypes
import subprocess
import types

import cv2
import numpy as np
import pytest
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from airrace.common.errors import UserError
from airrace.rendering.planar.renderer import PlanarRenderer
from airrace.rendering.scene.scenery import AddScenery
from airrace.rendering.scene.textures import SUN_W
from airrace.rendering.vtk.vtk_renderer import AddVtkRenderer, check_vtk_available
from tests.worlds.cases import first
from tests.worlds.pictures import (
    CAMERA_INFO,
    CORNERS_M,
    grey,
    look_at,
    measure_corners,
    new_picture,
    one_gate,
    project,
)

TRACK = one_gate()


@pytest.fixture(scope="module")
def vtk_available():
    try:
        check_vtk_available()
    except UserError as e:
        pytest.skip(str(e))


def make_vtk(supersampling):
    """Returns a function of X_WC that returns a picture."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=1e-3)
    AddScenery(plant, TRACK)
    plant.Finalize()
    renderer = AddVtkRenderer(scene_graph, CAMERA_INFO, supersampling=supersampling)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()

    def render(X_WC):
        scene_context = scene_graph.GetMyContextFromRoot(context)
        query_object = scene_graph.get_query_output_port().Eval(scene_context)
        picture = new_picture()
        renderer.render(X_WC, picture, query_object)
        assert np.all(picture[..., 3] == 255)
        return picture

    return render


@pytest.fixture(scope="module")
def vtk(vtk_available):
    return make_vtk(supersampling=1)


def render_planar(X_WC):
    picture = new_picture()
    PlanarRenderer(TRACK, CAMERA_INFO).render(X_WC, picture)
    return picture


def views(count):
    """Random poses up to 30 m before a board, and the corners seen there."""
    rng = np.random.default_rng(11)
    result = []
    while len(result) < count:
        board = TRACK.boards()[rng.integers(4)]
        azimuth, elevation = rng.uniform(-0.8, 0.8), rng.uniform(-0.15, 0.4)
        p_MC = rng.uniform(4, 30) * np.array([np.sin(azimuth), np.sin(elevation), np.cos(azimuth)])
        target = board.X_WM @ rng.uniform(-1.0, 1.0, 3)
        X_WC = look_at(board.X_WM @ p_MC, target, roll=rng.uniform(-3, 3))
        corners, _ = project(CAMERA_INFO.K, X_WC, (board.X_WM @ CORNERS_M.T).T)
        if np.all(corners > 40) and np.all(corners < [1240, 680]):
            result.append((X_WC, corners))
    return result


# One sample a pixel aliases a little more than the planar renderer does.
@pytest.mark.slow
@pytest.mark.parametrize("supersampling, rms, count", first([(1, 0.25, 12), (2, 0.15, 15)]))
def test_renderers_agree_on_corners(vtk_available, supersampling, rms, count):
    vtk = make_vtk(supersampling)
    from_vtk, from_planar = [], []
    for X_WC, corners in views(count):
        from_vtk.append(measure_corners(grey(vtk(X_WC)), corners) - corners)
        from_planar.append(measure_corners(grey(render_planar(X_WC)), corners) - corners)
    difference = np.concatenate(from_vtk) - np.concatenate(from_planar)
    assert np.abs(difference.mean(axis=0)).max() < 0.1
    assert np.sqrt(np.mean(np.sum(difference**2, axis=1))) < rms
    # The centres of markers are better still.
    centres = np.mean(from_vtk, axis=1) - np.mean(from_planar, axis=1)
    assert np.abs(centres.mean(axis=0)).max() < 0.05


@pytest.mark.slow
def test_renderers_show_the_same_scene(vtk):
    for p_WC, target, roll in (
        ([0.0, 0.0, 5.0], [20.0, 0.0, 5.0], 0.0),
        ([10.0, -6.0, 8.0], [20.0, 1.0, 4.0], 0.7),
        ([35.0, 3.0, 6.0], [20.0, 0.0, 6.0], -0.3),
    ):
        X_WC = look_at(p_WC, target, roll)
        pictures = [render(X_WC)[..., :3].astype(int) for render in (vtk, render_planar)]
        # What is orange (pylons), and what is nearly black (markers).
        for is_part in (lambda p: p[..., 0] - p[..., 2] > 75, lambda p: p.max(axis=2) < 35):
            a, b = (is_part(p) for p in pictures)
            assert a.sum() > 500
            assert (a & b).sum() > 0.7 * (a | b).sum()


@pytest.mark.slow
def test_boards_have_contrast_on_all_sides(vtk):
    for board in TRACK.boards():
        X_WC = look_at(board.X_WM @ [3.0, 0.5, 6.0], board.X_WM.translation())
        # The border and the black frame below the middle of the upper edge.
        (light, dark), _ = project(
            CAMERA_INFO.K, X_WC, [board.X_WM @ [0.0, 0.68, 0.0], board.X_WM @ [0.0, 0.52, 0.0]]
        )
        picture = grey(vtk(X_WC))
        u, v = np.round(light).astype(int)
        assert picture[v, u] > 150
        u, v = np.round(dark).astype(int)
        assert picture[v, u] < 40


@pytest.mark.slow
def test_boards_can_be_read_from_any_side(vtk):
    """In the sun, in the shade, and however the camera is turned."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_ARUCO_ORIGINAL)
    detector = cv2.aruco.ArucoDetector(dictionary)
    for board in list(TRACK.boards())[::2]:
        for azimuth in (-0.9, 0.4):
            p_MC = 8 * np.array([np.sin(azimuth), 0.0, np.cos(azimuth)])
            beside = board.X_WM.translation() + np.array([0.0, -3.0 * np.sign(azimuth), 0.0])
            for target in (board.X_WM.translation(), beside):
                picture = vtk(look_at(board.X_WM @ p_MC, target))
                _, ids, _ = detector.detectMarkers(cv2.cvtColor(picture, cv2.COLOR_RGBA2GRAY))
                assert ids is not None and board.id in ids


def test_sky_and_horizon_are_the_planar_ones(vtk):
    X_WC = look_at([0.0, 0.0, 5.0], [-20.0, 1.0, 6.0])
    a, b = vtk(X_WC)[..., :3].astype(int), render_planar(X_WC)[..., :3].astype(int)
    assert np.array_equal(a[:300], b[:300])
    # The ground fades into it: no edge shows where its mesh ends.
    rows = a[360:480].mean(axis=1)
    assert np.abs(np.diff(rows, axis=0)).max() < 20


def test_pylons_cast_shadows_on_the_grass(vtk):
    X_WC = look_at([20.0, -20.0, 12.0], [22.0, 5.0, 0.0])
    picture = grey(vtk(X_WC))
    away = -SUN_W[:2] / SUN_W[2]
    for foot in TRACK.pylons():
        axis = np.array([*(foot[:2] + 5 * away), 0.0])  # of the shadow of a height of 5 m
        across = 4 * np.array([-away[1], away[0], 0.0]) / np.linalg.norm(away)
        spots, _ = project(CAMERA_INFO.K, X_WC, [axis, axis + across, axis - across])
        levels = [
            picture[v - 4 : v + 5, u - 4 : u + 5].mean() for u, v in np.round(spots).astype(int)
        ]
        assert levels[0] < 0.75 * min(levels[1:])


@pytest.fixture
def unchecked():
    check_vtk_available.cache_clear()
    yield
    check_vtk_available.cache_clear()


def test_missing_library_is_named(monkeypatch, unchecked):
    def load(name):
        raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr(ctypes, "CDLL", load)
    with pytest.raises(UserError, match="libEGL.so.1.*apt-get install libegl1.*planar"):
        check_vtk_available()


def test_missing_driver_is_named(monkeypatch, unchecked):
    monkeypatch.setattr(ctypes, "CDLL", lambda name: None)
    # Drake crashes then (signal 11), which only a process on trial survives.
    crash = types.SimpleNamespace(returncode=-11)
    monkeypatch.setattr(subprocess, "run", lambda *args, **kwargs: crash)
    with pytest.raises(UserError, match="driver.*planar"):
        check_vtk_available()
