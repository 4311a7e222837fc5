"""The recorder of a race."""

from pathlib import Path

from pydrake.systems.framework import Diagram

from airrace.common.resources import find_yaml
from airrace.recording.race_recorder import RaceRecorder
from airrace.recording.writer import FILE, RaceLog
from airrace.scenario import Scenario, scenario_yaml
from airrace.scenario.limits import parse_limits
from airrace.track import load_track
from airrace.vehicle import find_vehicle, load_vehicle

_NAME = "race_recorder"
_FAST = 40.0  # m/s, shown red at most


def AddRecorder(
    builder, scenario: Scenario, simulation: Diagram, autonomy: Diagram, output_dir: Path
) -> RaceRecorder | None:
    """Adds what writes race.mcap, unless the scenario wants none.

    Args:
        builder: of the race.
        scenario: the race.
        simulation, autonomy: the two diagrams in it.
        output_dir: where the file goes.

    Raises:
        UserError: if it cannot be written.
    """
    if scenario.recording.content == "none":
        return None
    log = RaceLog(Path(output_dir) / FILE)
    log.attach("scenario.yaml", scenario_yaml(scenario))
    log.attach("track.yaml", find_yaml("tracks", scenario.track).read_text(encoding="utf-8"))
    log.attach("vehicle.yaml", find_vehicle(scenario.drone).read_text(encoding="utf-8"))
    recorder = builder.AddNamedSystem(
        _NAME,
        RaceRecorder(
            log=log,
            config=scenario.recording,
            track=load_track(scenario.track),
            vehicle=load_vehicle(scenario.drone)[0],
            fps=scenario.camera.fps,
            max_speed=min(parse_limits(scenario.planner.limits)[0], _FAST),
            moving_gates=simulation.HasOutputPort("truth.gate_shifts"),
        ),
    )
    for i in range(recorder.num_input_ports()):
        port = recorder.get_input_port(i)
        for source in (simulation, autonomy):
            if source.HasOutputPort(port.get_name()):
                builder.Connect(source.GetOutputPort(port.get_name()), port)
                break
    return recorder


def close_recording(race: Diagram) -> None:
    """Ends the file that the recorder of a race writes, if it has one.

    Raises:
        UserError: if it cannot be written.
    """
    if race.HasSubsystemNamed(_NAME):
        race.GetSubsystemByName(_NAME).close()
