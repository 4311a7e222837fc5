"""The pad that the drone starts from, where it is not level."""

from typing import TYPE_CHECKING

import numpy as np
from pydrake.geometry import Convex, GeometryInstance, IllustrationProperties, Rgba
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant

if TYPE_CHECKING:
    from airrace.track import Start

_COLOR = Rgba(0.35, 0.35, 0.38, 1.0)
_FRICTION = CoulombFriction(static_friction=0.8, dynamic_friction=0.6)
_EDGE = 0.02  # m, height of the lowest edge


def pad_rotation(start: "Start") -> RotationMatrix:
    """Returns the rotation that tilts the level onto the pad of a Start."""
    downhill = RotationMatrix.MakeZRotation(np.deg2rad(start.pad_tilt_direction_deg))
    tilt = RotationMatrix.MakeYRotation(np.deg2rad(start.pad_tilt_deg))
    return downhill @ tilt @ downhill.inverse()


def start_pose(start: "Start", radius: float, standing_height: float) -> RigidTransform:
    """Returns X_WB of a drone that stands on its pad.

    Args:
        start: the Start of a track.
        radius: of the drone (m).
        standing_height: of its origin above what it stands on (m).
    """
    R_WP = pad_rotation(start)
    heading = RotationMatrix.MakeZRotation(np.deg2rad(start.heading_deg))
    return RigidTransform(R_WP @ heading, _middle(start, radius) + standing_height * R_WP.col(2))


def AddPad(plant: MultibodyPlant, start: "Start", radius: float) -> None:
    """Adds the pad of a start to a plant, if it is tilted: a wedge on the ground.

    It is drawn for spectators only: the drone's camera looks ahead and does
    not see it. Its collision geometry is named ``pad``.

    Args:
        plant: a MultibodyPlant before Finalize(), registered with a SceneGraph.
        start: the Start of a track.
        radius: of the drone (m).
    """
    if start.pad_tilt_deg == 0.0:
        return
    half = _half_width(radius)
    top = np.array([[x, y, 0.0] for x in (-half, half) for y in (-half, half)])
    R_WP = pad_rotation(start)
    downhill = RotationMatrix.MakeZRotation(np.deg2rad(start.pad_tilt_direction_deg))
    top = (R_WP @ downhill).matrix() @ top.T + _middle(start, radius)[:, None]
    foot = top * [[1.0], [1.0], [0.0]] + [[0.0], [0.0], [start.position[2]]]
    wedge = Convex(np.hstack([top, foot]), "pad")
    visual = GeometryInstance(RigidTransform(), wedge, "pad_visual")
    properties = IllustrationProperties()
    properties.AddProperty("phong", "diffuse", _COLOR)
    visual.set_illustration_properties(properties)
    plant.RegisterVisualGeometry(plant.world_body(), visual)
    plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), wedge, "pad", _FRICTION)


def _half_width(radius: float) -> float:
    return radius + 0.2


def _middle(start: "Start", radius: float) -> np.ndarray:
    """Returns the centre of the pad's top, (3,)."""
    if start.pad_tilt_deg == 0.0:
        return np.array(start.position, float)
    rise = _EDGE + _half_width(radius) * np.sin(np.deg2rad(start.pad_tilt_deg))
    return np.array(start.position) + [0.0, 0.0, rise]
