"""The course and its pad as bodies: what can be seen and what can be hit."""

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from pydrake.geometry import Box as DrakeBox
from pydrake.geometry import (
    Convex,
    GeometryInstance,
    IllustrationProperties,
    Mesh,
    PerceptionProperties,
    Rgba,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, RigidBody, SpatialInertia

from airrace.rendering.scene.meshes import (
    BOARD_THICKNESS,
    board_mesh,
    ground_mesh,
    pylon_mesh,
    shadow_mesh,
)
from airrace.rendering.scene.pylon_shape import make_pylon_shape
from airrace.rendering.scene.shadows import pylon_shadow
from airrace.rendering.scene.solids import (
    CEILING_COLORS,
    COLUMN_COLOR,
    FLOOR_COLORS,
    GATE_COLOR,
    LETTER_COLOR,
    LIGHT_COLOR,
    PANEL_COLOR,
    WALL_COLORS,
)
from airrace.track import BOARD_SIZE
from airrace.track.course import Box
from airrace.track.start import Start, pad_half_width, pad_middle, pad_rotation

if TYPE_CHECKING:
    from pydrake.systems.framework import Context

    from airrace.track import Course
    from airrace.track.hall import Hall

_FRICTION = CoulombFriction(static_friction=0.8, dynamic_friction=0.6)
_PAD_COLOR = Rgba(0.35, 0.35, 0.38, 1.0)
_THIN = 0.02  # m, of a floor that is drawn upon the ground
EVERYBODY, CAMERAS = "everybody", "cameras"  # who sees a thing: a roof would hide all from above


def AddScenery(
    plant: MultibodyPlant, track: "Course", movable: bool = False, visible: bool = True
) -> None:
    """Adds the ground, the gates and all that stands on a course to a plant.

    Everything is fixed to the world, or gates of pylons to bodies that move_gates() moves. The
    collision geometries are named ``ground``, ``pylon_<gate from 1>_<left|right>``,
    ``board_<marker ID>``, ``gate_<from 1>_<top|bottom|left|right>``,
    ``wall_<east|west|north|south>``, ``ceiling`` and ``column_<from 1>``, which tells what a
    contact touched. Nothing is read from or written to disk.

    Args:
        plant: before Finalize(), registered with a SceneGraph.
        movable: whether the gates can be moved. It costs every step of the plant.
        visible: whether somebody will look, through Meshcat or a RenderEngine.
    """
    hall, n = track.hall(), len(track.gates)
    if visible and hall is None:
        _show_mesh(plant, "ground", plant.world_body(), RigidTransform(), ground_mesh)
    # Drake warns about every HalfSpace, so the ground is a very large box.
    below, ground = RigidTransform([0.0, 0.0, -10.0]), DrakeBox(4000.0, 4000.0, 20.0)
    plant.RegisterCollisionGeometry(plant.world_body(), below, ground, "ground", _FRICTION)
    bodies = _add_gate_bodies(plant, n) if movable else [plant.world_body()] * n
    _add_pylons(plant, track, bodies, visible)
    for i, gate in enumerate(track.frames(), 1):
        for side, box in gate.boxes().items():
            _add_box(plant, f"gate_{i}_{side}", box, GATE_COLOR, visible)
        for k, box in enumerate(gate.letters() if visible else ()):
            _show_box(plant, f"gate_{i}_letter_{k}", box, LETTER_COLOR, EVERYBODY)
    if hall is not None:
        _add_hall(plant, hall, visible)


def _add_pylons(
    plant: MultibodyPlant, track: "Course", bodies: Sequence[RigidBody], visible: bool
) -> None:
    """Adds the pylons and their boards to the bodies of their gates."""

    def add(name, body, X_WG, mesh, shape, X_GS=RigidTransform()):
        if visible:
            _show_mesh(plant, name, body, X_WG, mesh)
        plant.RegisterCollisionGeometry(body, X_WG @ X_GS, shape, name, _FRICTION)

    # Few vertices suffice for contact: the flank is a few millimetres off.
    outline = make_pylon_shape(16, 1).vertices
    pylon = functools.cache(pylon_mesh)
    boards = track.boards()
    for i, foot in enumerate(track.pylons()):
        name = f"pylon_{i // 2 + 1}_{('left', 'right')[i % 2]}"
        X_WG = RigidTransform(foot)
        add(name, bodies[i // 2], X_WG, pylon, Convex(outline.T, "pylon"))
        if visible:
            mesh = shadow_mesh(*pylon_shadow(foot, boards[2 * i : 2 * i + 2]))
            shadow = GeometryInstance(X_WG, Mesh(mesh), f"{name}_shadow")
            # For render engines only: Meshcat shows no transparent textures.
            shadow.set_perception_properties(PerceptionProperties())
            plant.RegisterVisualGeometry(bodies[i // 2], shadow)

    box = DrakeBox(BOARD_SIZE, BOARD_SIZE, BOARD_THICKNESS)
    behind_face = RigidTransform(np.array([0.0, 0.0, -BOARD_THICKNESS / 2]))
    for board in boards:
        face = functools.partial(board_mesh, board.id)
        add(f"board_{board.id}", bodies[board.id // 4], board.X_WM, face, box, behind_face)


def _add_hall(plant: MultibodyPlant, hall: "Hall", visible: bool) -> None:
    for name, box in hall.shell().items():
        color = CEILING_COLORS[0] if name == "ceiling" else WALL_COLORS[0]
        _add_box(plant, name, box, color, visible, CAMERAS)
    for i, box in enumerate(hall.columns, 1):
        _add_box(plant, f"column_{i}", box, COLUMN_COLOR, visible)
    if visible:
        for i, box in enumerate(hall.lights, 1):
            _show_box(plant, f"light_{i}", box, LIGHT_COLOR, CAMERAS)
            _show_box(plant, f"panel_{i}", hall.panels[i - 1], PANEL_COLOR, CAMERAS)
        size, middle = hall.high - hall.low, (hall.low + hall.high) / 2
        floor = Box(RigidTransform([*middle[:2], -_THIN / 2]), np.array([size[0], size[1], _THIN]))
        _show_box(plant, "floor", floor, FLOOR_COLORS[0], EVERYBODY)


def AddPad(plant: MultibodyPlant, start: Start, radius: float) -> None:
    """Adds the pad of a start to a plant, if it is tilted: a wedge on the ground.

    It is drawn for spectators only: the drone's camera looks ahead and does
    not see it. Its collision geometry is named ``pad``.

    Args: plant: see AddScenery(). start, radius: of the track, and of the drone (m).
    """
    if start.pad_tilt_deg == 0.0:
        return
    half = pad_half_width(radius)
    top = np.array([[x, y, 0.0] for x in (-half, half) for y in (-half, half)])
    R_WP = pad_rotation(start)
    downhill = RotationMatrix.MakeZRotation(np.deg2rad(start.pad_tilt_direction_deg))
    top = (R_WP @ downhill).matrix() @ top.T + pad_middle(start, radius)[:, None]
    foot = top * [[1.0], [1.0], [0.0]] + [[0.0], [0.0], [start.position[2]]]
    wedge = Convex(np.hstack([top, foot]), "pad")
    visual = GeometryInstance(RigidTransform(), wedge, "pad_visual")
    properties = IllustrationProperties()
    properties.AddProperty("phong", "diffuse", _PAD_COLOR)
    visual.set_illustration_properties(properties)
    plant.RegisterVisualGeometry(plant.world_body(), visual)
    plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), wedge, "pad", _FRICTION)


def _add_box(plant, name, box, color, visible, seen_by=EVERYBODY):
    if visible:
        _show_box(plant, name, box, color, seen_by)
    world, shape = plant.world_body(), DrakeBox(*box.size)
    plant.RegisterCollisionGeometry(world, box.X_WB, shape, name, _FRICTION)


def _show_box(
    plant: MultibodyPlant, name: str, box: Box, color: Sequence[float], seen_by: str
) -> None:
    """Adds what is seen of a box; color: RGB from 0 to 255."""
    visual = GeometryInstance(box.X_WB, DrakeBox(*box.size), f"{name}_visual")
    diffuse = Rgba(*(level / 255 for level in color))
    perception = PerceptionProperties()
    perception.AddProperty("phong", "diffuse", diffuse)
    visual.set_perception_properties(perception)
    if seen_by == EVERYBODY:
        illustration = IllustrationProperties()
        illustration.AddProperty("phong", "diffuse", diffuse)
        visual.set_illustration_properties(illustration)
    plant.RegisterVisualGeometry(plant.world_body(), visual)


def _show_mesh(plant, name, body, X_WG, mesh):
    visual = GeometryInstance(X_WG, Mesh(mesh()), f"{name}_visual")
    # Without properties it gets the illustration and the perception role.
    plant.RegisterVisualGeometry(body, visual)


def _add_gate_bodies(plant: MultibodyPlant, n: int) -> list:
    """Adds a body for each of n gates; at first, its frame is the world's."""
    instance = plant.AddModelInstance("gates")
    bodies = []
    for i in range(n):
        # A weld leaves no joint to move, but the frame that it welds to is a
        # parameter of the plant's Context.
        place = FixedOffsetFrame(_place_name(i), plant.world_frame(), RigidTransform(), instance)
        # What stands still needs no mass.
        bodies.append(plant.AddRigidBody(f"gate_{i + 1}", instance, SpatialInertia.Zero()))
        plant.WeldFrames(plant.AddFrame(place), bodies[-1].body_frame())
    return bodies


def move_gates(plant: MultibodyPlant, context: "Context", shifts: np.ndarray) -> None:
    """Moves the gates of a plant that AddScenery() filled, where they are movable.

    Args: context: of the plant. shifts: of every gate from its place in the track, (n, 2) m.
    """
    for i, (x, y) in enumerate(shifts):
        place = plant.GetFrameByName(_place_name(i))
        X_WG = RigidTransform([x, y, 0.0])
        # To write is to compute everything anew that depends on it.
        if not place.GetPoseInParentFrame(context).IsExactlyEqualTo(X_WG):
            place.SetPoseInParentFrame(context, X_WG)


def _place_name(i: int) -> str:
    return f"place_of_gate_{i + 1}"
