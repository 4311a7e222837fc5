"""The track as bodies: what can be seen and what can be hit."""

import numpy as np
from pydrake.geometry import (
    Box,
    Convex,
    GeometryInstance,
    Mesh,
    PerceptionProperties,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction

from airrace.rendering.meshes import (
    BOARD_THICKNESS,
    board_mesh,
    ground_mesh,
    pylon_mesh,
    shadow_mesh,
)
from airrace.rendering.pylon_shape import make_pylon_shape
from airrace.rendering.shadows import pylon_shadow
from airrace.track import BOARD_SIZE

_FRICTION = CoulombFriction(static_friction=0.8, dynamic_friction=0.6)


def AddScenery(plant, track) -> None:
    """Adds the ground, the pylons and the boards of a track to a plant.

    Everything is fixed to the world. The collision geometries are named
    ``ground``, ``pylon_<gate from 1>_<left|right>`` and ``board_<marker ID>``,
    which tells what a contact touched. Nothing is read from or written to disk.

    Args:
        plant: a MultibodyPlant before Finalize(), registered with a SceneGraph.
        track: a Track.
    """
    world = plant.world_body()

    def add(name, X_WG, mesh, shape, X_GS=RigidTransform()):
        visual = GeometryInstance(X_WG, Mesh(mesh), f"{name}_visual")
        # Without properties it gets the illustration and the perception role.
        plant.RegisterVisualGeometry(world, visual)
        plant.RegisterCollisionGeometry(world, X_WG @ X_GS, shape, name, _FRICTION)

    # Drake warns about every HalfSpace, so the ground is a very large box.
    ground = Box(4000.0, 4000.0, 20.0)
    add("ground", RigidTransform(), ground_mesh(), ground, RigidTransform([0.0, 0.0, -10.0]))

    # Few vertices suffice for contact: the flank is a few millimetres off.
    outline = make_pylon_shape(16, 1).vertices
    pylon = pylon_mesh()
    boards = track.boards()
    for i, foot in enumerate(track.pylons()):
        name = f"pylon_{i // 2 + 1}_{('left', 'right')[i % 2]}"
        X_WG = RigidTransform(foot)
        add(name, X_WG, pylon, Convex(outline.T, "pylon"))
        mesh = shadow_mesh(*pylon_shadow(foot, boards[2 * i : 2 * i + 2]))
        shadow = GeometryInstance(X_WG, Mesh(mesh), f"{name}_shadow")
        # For render engines only: Meshcat shows no transparent textures.
        shadow.set_perception_properties(PerceptionProperties())
        plant.RegisterVisualGeometry(world, shadow)

    box = Box(BOARD_SIZE, BOARD_SIZE, BOARD_THICKNESS)
    behind_face = RigidTransform(np.array([0.0, 0.0, -BOARD_THICKNESS / 2]))
    for board in boards:
        add(f"board_{board.id}", board.X_WM, board_mesh(board.id), box, behind_face)
