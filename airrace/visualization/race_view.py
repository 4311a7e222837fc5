"""The live view of a race: everything that is drawn in its Meshcat beside the scene."""

from typing import TYPE_CHECKING

from pydrake.geometry import Meshcat

from airrace.track import load_track
from airrace.vehicle import load_vehicle
from airrace.visualization.camera_inset import RAYS, CameraInset
from airrace.visualization.map_visualizer import MapVisualizer
from airrace.visualization.meshcat_page import HUD, overview
from airrace.visualization.paths import PathVisualizer
from airrace.visualization.plan_visualizer import PlanVisualizer
from airrace.visualization.rotor_visualizer import RotorVisualizer, body_path
from airrace.visualization.scoreboard import Scoreboard
from airrace.visualization.views import ViewDirector

if TYPE_CHECKING:
    from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort

    from airrace.scenario import Scenario

_DIRECTOR = "view_director"


def AddVisualization(
    builder: "DiagramBuilder",
    scenario: "Scenario",
    simulation: "Diagram",
    autonomy: "Diagram",
    meshcat: Meshcat,
) -> None:
    """Adds the live view of a race to its Meshcat.

    Args:
        builder: of the race.
        scenario: the race.
        simulation, autonomy: the two diagrams in it.
        meshcat: that the simulation draws its scene in.
    """
    track = load_track(scenario.track)
    vehicle, _ = load_vehicle(scenario.drone)
    plant = simulation.GetSubsystemByName("plant")
    scene_graph = simulation.GetSubsystemByName("scene_graph")
    path = body_path(plant)
    systems = {
        "path_visualizer": PathVisualizer(meshcat=meshcat),
        "plan_visualizer": PlanVisualizer(meshcat=meshcat),
        "map_visualizer": MapVisualizer(meshcat=meshcat),
        "rotor_visualizer": RotorVisualizer(
            meshcat=meshcat, vehicle=vehicle, plant=plant, scene_graph=scene_graph
        ),
        "camera_inset": CameraInset(meshcat=meshcat, body_path=path),
        "scoreboard": Scoreboard(meshcat=meshcat, gates=len(track.gates), laps=scenario.laps),
        _DIRECTOR: ViewDirector(
            meshcat=meshcat, overview=overview(track), body_path=path, X_BC=vehicle.camera.X_BC
        ),
    }
    for name, box in systems.items():
        wanted = [box.get_input_port(i) for i in range(box.num_input_ports())]  # type: ignore[attr-defined]
        found = [_output(port.get_name(), simulation, autonomy) for port in wanted]
        if None in found:
            continue  # an autonomy that is elsewhere does not tell all
        builder.AddNamedSystem(name, box)
        for source, port in zip(found, wanted):
            builder.Connect(source, port)


def _output(name: str, *diagrams: "Diagram") -> "OutputPort | None":
    """Returns the output port of that name of the first diagram that has it, or None."""
    return next((d.GetOutputPort(name) for d in diagrams if d.HasOutputPort(name)), None)


def view_director(race: "Diagram") -> ViewDirector:
    """Returns the ViewDirector of a race with a live view."""
    return race.GetSubsystemByName(_DIRECTOR)


def end_live_view(race: "Diagram", meshcat: Meshcat) -> None:
    """Takes away what only makes sense live, so that what is left is a replay."""
    view_director(race).end()
    meshcat.Delete(HUD)
    meshcat.Delete(RAYS)
    meshcat.DeleteAddedControls()
