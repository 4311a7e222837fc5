"""The live view of a race: what tells its page of the race."""

from typing import TYPE_CHECKING

from airrace.track.square_track import load_course
from airrace.vehicle import load_vehicle
from airrace.visualization.meshcat_page import Audience
from airrace.visualization.page_html import LIVE, page_config
from airrace.visualization.page_sink import PageSink
from airrace.visualization.rotor_visualizer import PERIOD, RotorVisualizer, body_path

if TYPE_CHECKING:
    from pydrake.systems.framework import Diagram

    from airrace.recording.race_events import Sink
    from airrace.scenario import Scenario
    from airrace.visualization.live_page import LivePage


def MakePageSinks(
    scenario: "Scenario", simulation: "Diagram", page: "LivePage"
) -> tuple["Sink", ...]:
    """Begins a page, and returns the sinks that show a race on it.

    Args:
        scenario: the race.
        simulation: that draws its scene in the page's Meshcat.
        page: of the race.
    """
    track, (vehicle, _) = load_course(scenario.track), load_vehicle(scenario.drone)
    plant = simulation.GetSubsystemByName("plant")
    scene_graph = simulation.GetSubsystemByName("scene_graph")
    page.begin(page_config(scenario, track, vehicle, body_path(plant), mode=LIVE))
    sink = PageSink(
        page.record,
        track,
        vehicle,
        meshcat=page.meshcat,
        audience=Audience(page.meshcat),
        keep_pictures=scenario.recording.content == "full",
    )
    audience = Audience(page.meshcat, PERIOD)
    rotors = RotorVisualizer(page.meshcat, vehicle, plant, scene_graph, audience)
    return sink.take, rotors.take
