"""The page: a Meshcat server that shows a track, and who watches it."""

import logging
import secrets
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from pydrake.geometry import (
    Meshcat,
    MeshcatParams,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    SceneGraph,
)
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from airrace.common.errors import UserError
from airrace.rendering.scene.textures import HORIZON, ZENITH

if TYPE_CHECKING:
    from airrace.track import Course

_OPENING = 3.0  # s, for which a page that opens is left alone
_LOOPBACK = "127.0.0.1"


def MakeMeshcat(track: "Course") -> Meshcat:
    """Starts a Meshcat server, see HiddenMeshcat(), that shows a track on a fine day.

    Args:
        track: the airrace.track.Track.

    Raises:
        UserError: if no port is free.
    """
    drake = logging.getLogger("drake")
    drake.setLevel(logging.WARNING)  # the programs print the address themselves
    drake.addFilter(_is_news)
    meshcat = HiddenMeshcat()
    meshcat.SetCameraPose(*overview(track))
    # Meshcat's default is a dim studio.
    meshcat.SetProperty("/Lights/AmbientLight/<object>", "intensity", 2.0)
    meshcat.SetProperty("/Background/<object>", "top_color", list(np.array(ZENITH) / 255))
    meshcat.SetProperty("/Background/<object>", "bottom_color", list(np.array(HORIZON) / 255))
    meshcat.SetProperty("/Cameras/default/rotated/<object>", "far", 1000.0)
    meshcat.SetProperty("/Grid", "visible", False)
    meshcat.SetProperty("/Axes", "visible", False)
    return meshcat


def HiddenMeshcat() -> Meshcat:
    """Starts a Meshcat server where no web site finds it.

    Meshcat takes WebSockets of pages from anywhere, and one byte ends its thread. So it listens
    at an address of loopback, 127.0.0.0/8, and at a port, that are both drawn: of 2^38 together,
    too many to be tried by a page in a browser. Programs of this computer can look them up.

    Raises:
        UserError: if there is no address to listen at.
    """
    drawn = f"127.{secrets.randbelow(256)}.{secrets.randbelow(256)}.{1 + secrets.randbelow(254)}"
    reason = ""
    for host in (drawn, _LOOPBACK):  # some computers have only the one address
        try:
            return Meshcat(MeshcatParams(host=host, port=0, show_stats_plot=False))
        except RuntimeError as e:
            reason = str(e).rstrip(".")
    raise UserError(
        f"Nothing can be shown in a browser ({reason}); close another program that uses Meshcat, "
        "or race with --no-meshcat."
    )


def _is_news(record: logging.LogRecord) -> bool:
    """Whether Drake says what the programs do not say themselves, or what matters.

    It warns if a slow page asks for a picture that is gone, and tells twice of a page that died.
    """
    message = record.getMessage()
    return "Unknown CAS key" not in message and "internal websocket" not in message


def overview(track: "Course") -> tuple[np.ndarray, np.ndarray]:
    """Returns from where all of a track is seen, and the point in the middle, in world (m)."""
    feet = track.outline()
    middle = feet.mean(axis=0)
    size = np.ptp(feet[:, :2], axis=0).max()
    return middle + [-0.35 * size, -0.6 * size, 0.5 * size], middle


def draw_bodies(meshcat: Meshcat, add: Callable[[MultibodyPlant, SceneGraph], object]) -> None:
    """Draws bodies that stand still.

    Args:
        meshcat: to draw in.
        add: a function that adds them to a MultibodyPlant and a SceneGraph.
    """
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    add(plant, scene_graph)
    plant.Finalize()
    MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat, MeshcatVisualizerParams())
    diagram = builder.Build()
    diagram.ForcedPublish(diagram.CreateDefaultContext())


class SceneDrawing:
    """Draws the scene of a Simulation in a Meshcat, from outside of its diagram.

    The two share nothing: whatever becomes of the Meshcat, the simulation goes on.
    """

    def __init__(self, meshcat: Meshcat, simulation: Diagram):
        """Args: meshcat: to draw in. simulation: see MakeSimulation(), with ``visible=True``."""
        self._scene_graph = simulation.GetSubsystemByName("scene_graph")
        builder = DiagramBuilder()
        self._copy = builder.AddSystem(self._scene_graph.Clone())
        MeshcatVisualizer.AddToBuilder(builder, self._copy, meshcat, MeshcatVisualizerParams())
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()

    def draw(self, root_context: Context) -> None:
        """Draws all bodies where they are; root_context: of the diagram with the simulation."""
        theirs = self._scene_graph.GetMyContextFromRoot(root_context)
        ours = self._copy.GetMyMutableContextFromRoot(self._context)
        for i in range(self._copy.num_input_ports()):
            poses = self._scene_graph.get_input_port(i)
            if poses.HasValue(theirs):
                self._copy.get_input_port(i).FixValue(ours, poses.Eval(theirs))
        self._diagram.ForcedPublish(self._context)


class Audience:
    """Who watches a page, and when they were last shown something.

    Some things are drawn only if somebody sees them, and no faster than eyes
    follow, however fast the race is simulated. That makes the page depend on the
    machine, but nothing in the race depends on the page.
    """

    def __init__(self, meshcat: Meshcat, period: float = 0.2):
        """Args: meshcat: of the page. period: the least between two drawings (s)."""
        self._meshcat = meshcat
        self._period = period
        self._next = 0.0
        self._watching = 0

    def waits(self) -> bool:
        """Whether somebody is there who has seen nothing new for a period of wall time."""
        now = time.perf_counter()
        if now < self._next:
            return False
        self._next = now + self._period
        before, self._watching = self._watching, self._meshcat.GetNumActiveConnections()
        if self._watching > before:  # a page that opens has enough to do
            self._next = now + _OPENING
            return False
        return self._watching > 0
