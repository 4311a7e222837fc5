"""What the planar renderer draws of square gates, and whether Drake's agrees."""

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from airrace.common.errors import UserError
from airrace.rendering.planar.renderer import PlanarRenderer
from airrace.rendering.scene.scenery import AddScenery
from airrace.rendering.scene.solids import GATE_COLOR
from airrace.rendering.vtk.vtk_renderer import AddVtkRenderer, check_vtk_available
from airrace.track import Start, load_track
from airrace.track.square_gate import SquareGate
from airrace.track.square_track import LAWN, SquareTrack
from airrace.vehicle.camera_info import make_camera_info
from tests.worlds.pictures import R_BC, look_at, project

INFO = make_camera_info(
    width=640, height=360, fov_y=np.deg2rad(58.7155), X_BC=RigidTransform(R_BC, [0, 0, 0])
)
COURSE = load_track("grand-prix")
GATE = SquareGate([10.0, 0.0, 3.0], 0.0)
ALONE = SquareTrack(
    "alone",
    surroundings=LAWN,
    start=Start([0.0, 0.0, 0.0]),
    gates=[GATE, SquareGate([200.0, 0.0, 3.0], 0.0)],
)


def draw(track, X_WC, info=INFO):
    picture = np.full((info.height, info.width, 4), 77, np.uint8)
    PlanarRenderer(track, info).render(X_WC, picture)
    assert np.all(picture[..., 3] == 255)
    return picture


def orange(picture):
    """Whether a pixel is of a gate."""
    p = picture[..., :3].astype(int)
    return (p[..., 0] > 150) & (p[..., 0] - p[..., 2] > 120)


def views(track, count):
    """Poses that look from gate to gate."""
    rng = np.random.default_rng(3)
    way = np.array([gate.p_WG for gate in track.gates])
    for _ in range(count):
        i = rng.integers(len(way) - 1)
        p = way[i] + rng.uniform(0.2, 0.6) * (way[i + 1] - way[i]) + rng.uniform(-0.5, 0.5, 3)
        yield look_at(p, way[i + 1] + rng.uniform(-1.0, 1.0, 3), roll=rng.uniform(-0.6, 0.6))


def test_the_camera_is_that_of_the_qualifier():
    np.testing.assert_allclose(INFO.K[0, 0], 320.0, atol=1e-3)
    np.testing.assert_allclose(INFO.K[1, 1], 320.0, atol=1e-3)


def test_a_frame_covers_the_pixels_between_its_squares():
    """By the areas of the projected squares, seen head-on: nothing of its sides is visible."""
    X_WC = look_at([4.0, 0.0, 3.0], [10.0, 0.0, 3.0])
    p, _ = project(INFO.K, X_WC, GATE.X_WG @ np.array([-0.13, 0, 0]) + np.zeros((1, 3)))
    f, z = INFO.K[0, 0], 10.0 - 0.13 - 4.0
    # Inside of the opening, the frame's depth is seen: from the front to the back inner square.
    back = 1.5 * f / (z + 0.26)
    letters = sum(box.size[1] * box.size[2] for box in GATE.letters()) / 2  # on the front
    expected = (2.72**2 - letters) * (f / z) ** 2 - back**2
    mask = orange(draw(ALONE, X_WC))
    assert mask.sum() == pytest.approx(expected, rel=0.02)
    rows, columns = np.nonzero(mask)
    middle = np.ptp(columns) / 2 + columns.min(), np.ptp(rows) / 2 + rows.min()
    assert middle == pytest.approx(tuple(p[0]), abs=0.5)


def test_a_gate_glows_in_the_dark():
    X_WC = look_at([4.0, 0.0, 3.0], [10.0, 0.0, 3.0])
    dark = SquareTrack(
        "dark", start=Start([0.0, 0.0, 0.0]), gates=ALONE.gates[:1] + [SquareGate([30.0, 0, 3], 0)]
    )
    picture = draw(dark, X_WC)
    front = picture[orange(picture)][:, :3]
    assert np.median(front, axis=0) == pytest.approx(GATE_COLOR, abs=1)
    others = picture[~orange(picture)][:, :3]
    assert np.median(others) < 60  # all else is dark, but for the lights
    assert (others.min(axis=1) > 230).sum() > 50


def test_nearer_solids_hide_farther_ones():
    near, far = SquareGate([6.0, 0.0, 3.0], 0.0), SquareGate([12.0, 0.9, 3.0], 0.0)
    track = SquareTrack("two", surroundings=LAWN, start=Start([0.0, 0.0, 0.0]), gates=[near, far])
    X_WC = look_at([0.0, 0.0, 3.0], [10.0, 0.0, 3.0])
    both = draw(track, X_WC)
    only = draw(
        SquareTrack("one", surroundings=LAWN, start=Start([0.0, 0.0, 0.0]), gates=[near]), X_WC
    )
    inner = np.all(only[..., :3] == GATE_COLOR, axis=2)  # without the mixed pixels of edges
    np.testing.assert_array_equal(both[inner], only[inner])
    assert inner.sum() > 1000 and orange(both).sum() > orange(only).sum() + 100


@pytest.fixture(scope="module")
def vtk():
    """Returns a function of X_WC that returns Drake's picture of the course."""
    try:
        check_vtk_available()
    except UserError as e:
        pytest.skip(str(e))
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=1e-3)
    AddScenery(plant, COURSE)
    plant.Finalize()
    renderer = AddVtkRenderer(scene_graph, INFO, indoors=True)
    context = builder.Build().CreateDefaultContext()

    def render(X_WC):
        scene_context = scene_graph.GetMyContextFromRoot(context)
        query_object = scene_graph.get_query_output_port().Eval(scene_context)
        picture = np.zeros((INFO.height, INFO.width, 4), np.uint8)
        renderer.render(X_WC, picture, query_object)
        return picture

    return render


@pytest.mark.slow
def test_renderers_show_the_same_gates(vtk):
    """In the same pixels, in about the same colours; lights and walls, too."""
    for X_WC in views(COURSE, 6):
        ours, drakes = draw(COURSE, X_WC), vtk(X_WC)
        a, b = orange(ours), orange(drakes)
        assert a.sum() > 300
        assert (a & b).sum() > 0.85 * (a | b).sum()
        rows, columns = np.nonzero(a)
        others = np.nonzero(b)
        assert abs(rows.mean() - others[0].mean()) < 1.0
        assert abs(columns.mean() - others[1].mean()) < 1.0
        colors = [np.median(p[a & b][:, :3], axis=0) for p in (ours, drakes)]
        np.testing.assert_allclose(*colors, atol=45)
        light = [(p[..., :3].min(axis=2) > 200) for p in (ours, drakes)]
        assert (light[0] & light[1]).sum() >= 0.6 * light[0].sum()
        dark = [np.median(p[~(a | b)][:, :3]) for p in (ours, drakes)]
        assert max(dark) < 60
