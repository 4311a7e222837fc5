"""The live view of a race: what its page is told, and what is drawn in its Meshcat."""

from typing import TYPE_CHECKING

from airrace.scenario.camera_config import NO_CAMERA
from airrace.systems.leaf_system import LeafSystem
from airrace.track import load_track
from airrace.vehicle import load_vehicle
from airrace.visualization.meshcat_page import Audience
from airrace.visualization.page_html import LIVE, page_config
from airrace.visualization.plan_visualizer import PlanVisualizer
from airrace.visualization.race_feed import RaceFeed
from airrace.visualization.rotor_visualizer import RotorVisualizer, body_path

if TYPE_CHECKING:
    from pydrake.systems.framework import Diagram, DiagramBuilder

    from airrace.scenario import Scenario
    from airrace.visualization.live_page import LivePage


def AddVisualization(
    builder: "DiagramBuilder",
    scenario: "Scenario",
    simulation: "Diagram",
    autonomy: "Diagram",
    page: "LivePage",
) -> None:
    """Adds the live view of a race to its page.

    Args:
        builder: of the race.
        scenario: the race.
        simulation, autonomy: the two diagrams in it.
        page: whose Meshcat the simulation draws its scene in.
    """
    track = load_track(scenario.track)
    vehicle, _ = load_vehicle(scenario.drone)
    plant = simulation.GetSubsystemByName("plant")
    scene_graph = simulation.GetSubsystemByName("scene_graph")
    camera = scenario.camera.renderer != NO_CAMERA
    feed = RaceFeed(
        record=page.record,
        track=track,
        vehicle=vehicle,
        audience=Audience(page.meshcat),
        camera=camera,
        keep_pictures=camera and scenario.recording.content == "full",
        moving_gates=simulation.HasOutputPort("truth.gate_shifts"),
        estimates=autonomy.HasOutputPort("slam_state"),
    )
    systems: dict[str, LeafSystem] = {
        "race_feed": feed,
        "rotor_visualizer": RotorVisualizer(
            meshcat=page.meshcat, vehicle=vehicle, plant=plant, scene_graph=scene_graph
        ),
    }
    if autonomy.HasOutputPort("lap_plan"):
        systems["plan_visualizer"] = PlanVisualizer(meshcat=page.meshcat)
    for name, box in systems.items():
        builder.AddNamedSystem(name, box)
        for i in range(box.num_input_ports()):
            port = box.get_input_port(i)
            for source in (simulation, autonomy):
                if source.HasOutputPort(port.get_name()):
                    builder.Connect(source.GetOutputPort(port.get_name()), port)
                    break
    page.begin(page_config(scenario, track, vehicle, body_path(plant), mode=LIVE))
