"""A course of square gates as bodies: what can be seen and what can be hit."""

from collections.abc import Sequence

import numpy as np
from pydrake.geometry import Box as DrakeBox
from pydrake.geometry import GeometryInstance, IllustrationProperties, PerceptionProperties, Rgba
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant

from airrace.rendering.scene.scenery import add_ground
from airrace.rendering.scene.solids import (
    CEILING_COLORS,
    COLUMN_COLOR,
    FLOOR_COLORS,
    GATE_COLOR,
    LIGHT_COLOR,
    WALL_COLORS,
)
from airrace.track.square_gate import Box
from airrace.track.square_track import SquareTrack

_FRICTION = CoulombFriction(static_friction=0.8, dynamic_friction=0.6)
_THIN = 0.02  # m, of a floor that is drawn upon the ground
EVERYBODY, CAMERAS = "everybody", "cameras"  # who sees a thing: a roof would hide all from above


def AddSquareScenery(plant: MultibodyPlant, track: SquareTrack, visible: bool = True) -> None:
    """Adds the ground, the gates and the hall of a course to a plant, fixed to the world.

    The collision geometries are named ``ground``, ``gate_<from 1>_<top|bottom|left|right>``,
    ``wall_<east|west|north|south>``, ``ceiling`` and ``column_<from 1>``, which tells what a
    contact touched.

    Args:
        plant: a MultibodyPlant before Finalize(), registered with a SceneGraph.
        track: the course.
        visible: whether somebody will look, through Meshcat or a RenderEngine.
    """
    hall = track.hall()
    add_ground(plant, visible=visible and hall is None)

    def add(name: str, box: Box, color: Sequence[float], seen_by: str = EVERYBODY) -> None:
        shape = DrakeBox(*box.size)
        world = plant.world_body()
        if visible:
            _show(plant, name, box, color, seen_by)
        plant.RegisterCollisionGeometry(world, box.X_WB, shape, name, _FRICTION)

    for i, gate in enumerate(track.gates, 1):
        for side, box in gate.boxes().items():
            add(f"gate_{i}_{side}", box, GATE_COLOR)
    if hall is None:
        return
    for name, box in hall.shell().items():
        color = CEILING_COLORS[0] if name == "ceiling" else WALL_COLORS[0]
        add(name, box, color, CAMERAS)
    for i, box in enumerate(hall.columns, 1):
        add(f"column_{i}", box, COLUMN_COLOR)
    if visible:
        for i, box in enumerate(hall.lights, 1):
            _show(plant, f"light_{i}", box, LIGHT_COLOR, CAMERAS)
        size, middle = hall.high - hall.low, (hall.low + hall.high) / 2
        floor = Box(RigidTransform([*middle[:2], -_THIN / 2]), np.array([size[0], size[1], _THIN]))
        _show(plant, "floor", floor, FLOOR_COLORS[0], EVERYBODY)


def _show(plant: MultibodyPlant, name: str, box: Box, color: Sequence[float], seen_by: str) -> None:
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
