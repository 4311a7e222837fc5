"""Bodies of the scenery: names, shapes, contacts."""

import numpy as np
import pytest
from pydrake.geometry import Box, Meshcat, MeshcatVisualizer, Role
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from airrace.rendering.scene.meshes import BOARD_THICKNESS, board_mesh, ground_mesh, pylon_mesh
from airrace.rendering.scene.scenery import AddScenery
from airrace.track import PYLON_BASE_RADIUS, PYLON_HEIGHT, PYLON_TIP_RADIUS, Start, load_track
from airrace.track.square_gate import SquareGate
from airrace.track.square_track import SquareTrack
from tests.worlds.ball import BallWorld
from tests.worlds.pictures import one_gate

RADIUS = 0.25


def make_world(track, visible=True):
    """A ball flying through the scenery of a track."""
    return BallWorld(RADIUS, lambda plant: AddScenery(plant, track, visible=visible))


@pytest.fixture(scope="module")
def world():
    return make_world(one_gate())  # pylons at x = 20, y = 5 and y = -5


@pytest.mark.parametrize(
    "start, velocity, duration, expected",
    [
        ([0.0, 0.0, 1.0], [3.0, 0.0, 0.0], 0.6, "ground"),
        ([17.0, 5.0, 3.0], [8.0, 0.0, 2.0], 0.4, "pylon_1_left"),
        ([20.3, -8.0, 2.0], [0.0, 8.0, 2.0], 0.4, "pylon_1_right"),
        ([20.0, 5.0, 12.5], [0.0, 0.0, 0.0], 0.4, "pylon_1_left"),  # the tip
        ([17.0, 5.0, 6.3], [8.0, 0.0, 1.0], 0.4, "board_0"),
        ([23.0, 5.0, 6.3], [-8.0, 0.0, 1.0], 0.4, "board_1"),
        ([17.0, -5.0, 6.3], [8.0, 0.0, 1.0], 0.4, "board_2"),
        ([23.0, -5.0, 6.3], [-8.0, 0.0, 1.0], 0.4, "board_3"),
    ],
)
def test_contacts_are_felt_and_named(world, start, velocity, duration, expected):
    touched, end = world.fly(start, velocity, duration)
    assert touched == {expected}
    # Nothing was passed through.
    assert end[2] > RADIUS - 0.01
    if expected.startswith("board") and velocity[0] > 0:
        assert end[0] < 19.0 - RADIUS + 0.02
    if expected == "pylon_1_left" and velocity[0] > 0:
        assert end[0] < 20.0


def test_nothing_is_touched_between_the_pylons(world):
    touched, end = world.fly([15.0, 0.0, 6.25], [20.0, 0.0, 3.0], 0.5)
    assert not touched
    assert end[0] == pytest.approx(25.0)


def test_flank_is_where_it_should_be(world):
    # The flank runs from the base's rim to the tip's.
    for z in (1.0, 4.0, 8.0, 11.0):
        radius = np.interp(z, [0, PYLON_HEIGHT], [PYLON_BASE_RADIUS, PYLON_TIP_RADIUS])
        for margin, expected in ((0.1, set()), (-0.1, {"pylon_1_left"})):
            start = [20.0, 5.0 - radius - RADIUS - margin, z]
            touched, _ = world.fly(start, np.zeros(3), 0.002)
            assert touched == expected


def test_geometry_names_and_roles():
    track = load_track("student-airrace")
    world = make_world(track)
    inspector = world.scene_graph.model_inspector()
    names = {
        role: {inspector.GetName(id) for id in inspector.GetAllGeometryIds(role)}
        for role in (Role.kProximity, Role.kPerception, Role.kIllustration)
    }
    expected = {"ground"} | {f"board_{i}" for i in range(40)}
    expected |= {f"pylon_{n}_{side}" for n in range(1, 11) for side in ("left", "right")}
    assert names[Role.kProximity] == expected | {"ball"}
    visuals = {f"{name}_visual" for name in expected}
    assert names[Role.kIllustration] == visuals
    shadows = {f"{name}_shadow" for name in expected if name.startswith("pylon")}
    assert names[Role.kPerception] == visuals | shadows
    # The face of a board is at the origin of M.
    for board in track.boards():
        (id,) = (
            i for i in inspector.GetAllGeometryIds(Role.kProximity)
            if inspector.GetName(i) == f"board_{board.id}"
        )  # fmt: skip
        box = inspector.GetShape(id)
        assert isinstance(box, Box)
        face = inspector.GetPoseInFrame(id) @ [0, 0, box.height() / 2]
        assert face == pytest.approx(board.X_WM.translation(), abs=1e-12)
        assert box.height() == BOARD_THICKNESS


def test_what_nobody_looks_at_can_be_hit_all_the_same():
    world = make_world(one_gate(), visible=False)
    inspector = world.scene_graph.model_inspector()
    for role in (Role.kPerception, Role.kIllustration):
        assert not inspector.GetAllGeometryIds(role)
    assert world.fly([17.0, 5.0, 6.3], [8.0, 0.0, 1.0], 0.4)[0] == {"board_0"}


@pytest.mark.parametrize("mesh", [board_mesh(5), pylon_mesh(), ground_mesh()])
def test_meshes_are_closed_in_themselves(mesh):
    lines = mesh.mesh_file.contents().decode().splitlines()
    count = {key: sum(line.split()[0] == key for line in lines) for key in ("v", "vt", "vn")}
    faces = [line.split()[1:] for line in lines if line.startswith("f ")]
    v = np.array([line.split()[1:] for line in lines if line.startswith("v ")], float)
    vn = np.array([line.split()[1:] for line in lines if line.startswith("vn ")], float)
    assert np.linalg.norm(vn, axis=1) == pytest.approx(1.0, abs=1e-3)
    for face in faces:
        numbers = np.array([corner.split("/") for corner in face], int)
        for column, key in enumerate(("v", "vt", "vn")):
            assert numbers[:, column].min() >= 1
            assert numbers[:, column].max() <= count[key]
        # Counter-clockwise as seen from where the normals point.
        a, b, c = v[numbers[:3, 0] - 1]
        assert np.cross(b - a, c - b) @ vn[numbers[0, 2] - 1] > 0
    name = next(line.split()[1] for line in lines if line.startswith("mtllib"))
    material = mesh.supporting_files[name].contents().decode()
    image = next(line.split()[1] for line in material.splitlines() if "map_Kd" in line)
    assert mesh.supporting_files[image].contents()[:4] == b"\x89PNG"


@pytest.mark.slow
def test_meshcat_scene_is_light():
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=1e-3)
    AddScenery(plant, load_track("student-airrace"))
    plant.Finalize()
    meshcat = Meshcat()
    empty = len(meshcat.StaticHtml())
    MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat)
    diagram = builder.Build()
    diagram.ForcedPublish(diagram.CreateDefaultContext())
    assert len(meshcat.StaticHtml()) - empty < 3e6


BALL = 0.1  # m
GATES = [SquareGate([10.0, 0.0, 3.0], 0.0), SquareGate([20.0, 5.0, 4.0], 60.0, pitch_deg=-20.0)]
COURSE = SquareTrack("two", gates=GATES, start=Start([0.0, 0.0, 0.0]))


def add_course(plant):
    """Adds the course; the ball has no weight."""
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    AddScenery(plant, COURSE)


@pytest.fixture(scope="module")
def course_world():
    return BallWorld(BALL, add_course)


@pytest.mark.parametrize("i", [0, 1])
@pytest.mark.parametrize(
    "y, z, side",
    [
        (0.0, 0.0, None),
        (0.6, 0.6, None),
        (-0.6, -0.6, None),
        (0.0, 0.7, "top"),
        (0.0, -0.7, "bottom"),
        (0.7, 0.0, "left"),
        (-0.7, 0.0, "right"),
        (1.3, 0.0, "left"),
        (1.5, 0.0, None),
        (0.0, 1.5, None),
    ],
)
def test_a_ball_passes_the_opening_and_hits_the_frame(course_world, i, y, z, side):
    gate = GATES[i]
    start = gate.X_WG @ np.array([-1.0, y, z])
    touched, _ = course_world.fly(start, 4.0 * gate.forward, 0.5)
    assert touched == ({f"gate_{i + 1}_{side}"} if side else set())


@pytest.mark.parametrize(
    "direction, name",
    [
        ([1.0, 0.0, 0.0], "wall_east"),
        ([-1.0, 0.0, 0.0], "wall_west"),
        ([0.0, 1.0, 0.0], "wall_north"),
        ([0.0, -1.0, 0.0], "wall_south"),
        ([0.0, 0.0, 1.0], "ceiling"),
        ([0.0, 0.0, -1.0], "ground"),
    ],
)
def test_the_hall_is_closed(course_world, direction, name):
    hall = COURSE.hall()
    direction = np.array(direction)
    start = np.array([5.0, -4.0, 6.5])
    sizes = np.where(direction > 0, hall.high - start, start - hall.low)
    gap = np.abs(direction) @ sizes
    touched, _ = course_world.fly(start, 20.0 * direction, gap / 20.0 + 0.05)
    assert touched == {name}


def test_who_looks_from_above_sees_no_roof(course_world):
    """The camera sees the whole hall, spectators only what is on its floor."""
    inspector = course_world.scene_graph.model_inspector()

    def seen(role):
        ids = inspector.GetAllGeometryIds(role)
        return {inspector.GetName(each).removesuffix("_visual") for each in ids}

    camera, spectators = seen(Role.kPerception), seen(Role.kIllustration)
    assert {"gate_1_top", "floor", "ceiling", "wall_east", "light_1"} <= camera
    assert {"gate_1_top", "floor"} <= spectators
    assert not {"ceiling", "wall_east", "light_1"} & spectators
