"""The pad that the drone starts from, where it is not level."""

import numpy as np
from pydrake.geometry import Convex, GeometryInstance, IllustrationProperties, Rgba
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant

from airrace.track.start import Start, pad_half_width, pad_middle, pad_rotation

_COLOR = Rgba(0.35, 0.35, 0.38, 1.0)
_FRICTION = CoulombFriction(static_friction=0.8, dynamic_friction=0.6)


def AddPad(plant: MultibodyPlant, start: Start, radius: float) -> None:
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
    half = pad_half_width(radius)
    top = np.array([[x, y, 0.0] for x in (-half, half) for y in (-half, half)])
    R_WP = pad_rotation(start)
    downhill = RotationMatrix.MakeZRotation(np.deg2rad(start.pad_tilt_direction_deg))
    top = (R_WP @ downhill).matrix() @ top.T + pad_middle(start, radius)[:, None]
    foot = top * [[1.0], [1.0], [0.0]] + [[0.0], [0.0], [start.position[2]]]
    wedge = Convex(np.hstack([top, foot]), "pad")
    visual = GeometryInstance(RigidTransform(), wedge, "pad_visual")
    properties = IllustrationProperties()
    properties.AddProperty("phong", "diffuse", _COLOR)
    visual.set_illustration_properties(properties)
    plant.RegisterVisualGeometry(plant.world_body(), visual)
    plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), wedge, "pad", _FRICTION)
