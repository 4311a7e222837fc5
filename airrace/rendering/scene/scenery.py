"""The track as bodies: what can be seen and what can be hit."""

import functools
from typing import TYPE_CHECKING

import numpy as np
from pydrake.geometry import Box, Convex, GeometryInstance, Mesh, PerceptionProperties
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, SpatialInertia

from airrace.rendering.scene.meshes import (
    BOARD_THICKNESS,
    board_mesh,
    ground_mesh,
    pylon_mesh,
    shadow_mesh,
)
from airrace.rendering.scene.pylon_shape import make_pylon_shape
from airrace.rendering.scene.shadows import pylon_shadow
from airrace.track import BOARD_SIZE

if TYPE_CHECKING:
    from pydrake.systems.framework import Context

    from airrace.track import Track

_FRICTION = CoulombFriction(static_friction=0.8, dynamic_friction=0.6)


def AddScenery(
    plant: MultibodyPlant, track: "Track", movable: bool = False, visible: bool = True
) -> None:
    """Adds the ground, the pylons and the boards of a track to a plant.

    Everything is fixed to the world, or gates to bodies that move_gates() moves.
    The collision geometries are named ``ground``, ``pylon_<gate from 1>_<left|right>``
    and ``board_<marker ID>``, which tells what a contact touched. Nothing is read from
    or written to disk.

    Args:
        plant: a MultibodyPlant before Finalize(), registered with a SceneGraph.
        track: a Track.
        movable: whether the gates can be moved. It costs every step of the plant.
        visible: whether somebody will look, through Meshcat or a RenderEngine. The
            pictures on the boards are most of the work.
    """
    world = plant.world_body()
    add_ground(plant, visible)
    n = len(track.gates)
    gates = _add_gate_bodies(plant, n) if movable else [world] * n

    def add(name, body, X_WG, mesh, shape, X_GS=RigidTransform()):
        if visible:
            _add_visual(plant, name, body, X_WG, mesh)
        plant.RegisterCollisionGeometry(body, X_WG @ X_GS, shape, name, _FRICTION)

    # Few vertices suffice for contact: the flank is a few millimetres off.
    outline = make_pylon_shape(16, 1).vertices
    pylon = functools.cache(pylon_mesh)
    boards = track.boards()
    for i, foot in enumerate(track.pylons()):
        name = f"pylon_{i // 2 + 1}_{('left', 'right')[i % 2]}"
        X_WG = RigidTransform(foot)
        add(name, gates[i // 2], X_WG, pylon, Convex(outline.T, "pylon"))
        if visible:
            mesh = shadow_mesh(*pylon_shadow(foot, boards[2 * i : 2 * i + 2]))
            shadow = GeometryInstance(X_WG, Mesh(mesh), f"{name}_shadow")
            # For render engines only: Meshcat shows no transparent textures.
            shadow.set_perception_properties(PerceptionProperties())
            plant.RegisterVisualGeometry(gates[i // 2], shadow)

    box = Box(BOARD_SIZE, BOARD_SIZE, BOARD_THICKNESS)
    behind_face = RigidTransform(np.array([0.0, 0.0, -BOARD_THICKNESS / 2]))
    for board in boards:
        body = gates[board.id // 4]
        face = functools.partial(board_mesh, board.id)
        add(f"board_{board.id}", body, board.X_WM, face, box, behind_face)


def add_ground(plant: MultibodyPlant, visible: bool = True) -> None:
    """Adds the ground, named ``ground``, to a plant; visible: whether its grass is seen."""
    world = plant.world_body()
    if visible:
        _add_visual(plant, "ground", world, RigidTransform(), ground_mesh)
    # Drake warns about every HalfSpace, so the ground is a very large box.
    below = RigidTransform([0.0, 0.0, -10.0])
    ground = Box(4000.0, 4000.0, 20.0)
    plant.RegisterCollisionGeometry(world, below, ground, "ground", _FRICTION)


def _add_visual(plant, name, body, X_WG, mesh):
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
    """Moves the gates of a plant with movable gates.

    Args:
        plant: that AddScenery() filled, finalized.
        context: of the plant.
        shifts: of every gate from its place in the track, (n, 2) m.
    """
    for i, (x, y) in enumerate(shifts):
        place = plant.GetFrameByName(_place_name(i))
        X_WG = RigidTransform([x, y, 0.0])
        # To write is to compute everything anew that depends on it.
        if not place.GetPoseInParentFrame(context).IsExactlyEqualTo(X_WG):
            place.SetPoseInParentFrame(context, X_WG)


def _place_name(i: int) -> str:
    return f"place_of_gate_{i + 1}"
