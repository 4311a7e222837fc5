"""Turning rotors."""

from typing import TYPE_CHECKING

import numpy as np
from pydrake.geometry import Box, Convex, Ellipsoid, Mesh, Meshcat, Role, SceneGraph
from pydrake.math import RigidTransform, RotationMatrix

from airrace.recording.race_events import RaceEvent, StateSample
from airrace.vehicle import Vehicle
from airrace.visualization.meshcat_page import Audience

if TYPE_CHECKING:
    from pydrake.multibody.plant import MultibodyPlant

# Of the true speed, which would be a blur or, sampled, seem to stand still.
SLOW_MOTION = 0.1
PERIOD = 1 / 15  # s of wall time, between two poses
_ON_AXIS = 0.01  # m
_NOT_ROUND = (Box, Convex, Ellipsoid, Mesh)


def find_blades(plant: "MultibodyPlant", scene_graph: SceneGraph, vehicle: Vehicle) -> list:
    """Returns what of a drone turns with its rotors, as it shows.

    That is every visual that is not round about the vertical and whose origin lies
    on the axis of a rotor: no names are asked of a drone of your own.

    Args:
        plant: with a link ``body``, finalized.
        scene_graph: with its geometry.
        vehicle: the rotor table.

    Returns:
        (index of the rotor, path below that of the body's frame, X_BG) of each.
    """
    hubs = np.array([r.position for r in vehicle.rotors])
    inspector = scene_graph.model_inspector()
    frame = plant.GetBodyFrameIdOrThrow(plant.GetBodyByName("body").index())
    blades = []
    for geometry in inspector.GetGeometries(frame, Role.kIllustration):
        X_BG = inspector.GetPoseInFrame(geometry)
        offsets = X_BG.translation() - hubs
        rotor = int(np.argmin(np.linalg.norm(offsets, axis=1)))
        on_axis = np.hypot(*offsets[rotor, :2]) < _ON_AXIS
        if on_axis and isinstance(inspector.GetShape(geometry), _NOT_ROUND):
            blades.append((rotor, inspector.GetName(geometry).replace("::", "/"), X_BG))
    return blades


def body_path(plant: "MultibodyPlant") -> str:
    """Returns where Drake's MeshcatVisualizer draws the drone of a plant."""
    body = plant.GetBodyByName("body")
    model = plant.GetModelInstanceName(body.model_instance()).replace("::", "/")
    return f"visualizer/{model}/body"


class RotorVisualizer:
    """A sink that turns the blades of the drone, in slow motion.

    Nothing is drawn if nobody watches, and the replay's drone does not turn its rotors.
    """

    def __init__(
        self, meshcat: Meshcat, vehicle: Vehicle, body: str, blades: list, audience: Audience
    ):
        """Constructs the visualizer.

        Args:
            meshcat: in which a MeshcatVisualizer draws the drone.
            vehicle: the rotor table.
            body, blades: of the drone, see body_path() and find_blades().
            audience: of the page.
        """
        self._meshcat, self._audience = meshcat, audience
        self._path, self._blades = body, blades
        signs = np.array([1.0 if r.direction == "ccw" else -1.0 for r in vehicle.rotors])
        self._factors, self._angles, self._time = SLOW_MOTION * signs, 0.0 * signs, 0.0

    def take(self, event: RaceEvent) -> None:
        """Turns the blades up to a StateSample."""
        if not isinstance(event, StateSample) or event.rotor_speeds is None:
            return
        self._angles += (event.time - self._time) * self._factors * event.rotor_speeds
        self._time = event.time
        if not self._audience.waits():
            return
        for rotor, name, X_BG in self._blades:
            R_BG = RotationMatrix.MakeZRotation(self._angles[rotor]) @ X_BG.rotation()
            X_BG = RigidTransform(R_BG, X_BG.translation())
            self._meshcat.SetTransform(f"{self._path}/{name}", X_BG)
