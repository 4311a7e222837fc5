"""Runs a race: Simulation and Autonomy joined in one Simulator (SITL)."""

import contextlib
import signal
import time
import types
from pathlib import Path

from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder

from airrace.common.errors import UserError
from airrace.common.files import write_json, write_text
from airrace.diagrams.in_process import InProcess
from airrace.diagrams.simulation import MakeSimulation, follow_gates
from airrace.hitl.transport import LOOK_PERIOD
from airrace.recording.race_result import RaceResult
from airrace.recording.wiring import AddRecorder, close_recording
from airrace.scenario import Scenario, scenario_yaml
from airrace.systems.mapping.gate_map_writer import GateMapWriter
from airrace.track import load_track
from airrace.track.gate_map import GateMap
from airrace.track.map_files import write_map
from airrace.visualization.controls import RaceControls
from airrace.visualization.race_view import AddVisualization, end_live_view, view_director

# What a race may leave in its folder.
RESULTS = (
    "scenario.yaml",
    "map.json",
    "map_statistics.json",
    "race.json",
    "race.mcap",
    "race.html",
    "report.html",
)
# Of the replay (Hz). Each gate that can move takes 120 bytes a frame.
_REPLAY_RATE, _REPLAY_RATE_OF_MOVING_GATES = 30.0, 10.0


def MakeRace(
    scenario: Scenario, output_dir: Path | None = None, meshcat=None, transport=None
) -> Diagram:
    """Builds a whole race: two subsystems, ``simulation`` and ``autonomy``.

    What the two exchange is joined by the names of their ports; the race has
    the outputs that a recorder needs.

    Args:
        scenario: the race.
        output_dir: where the map and the recording are kept on disk; None: nowhere.
        meshcat: a Meshcat to show the race in, or None.
        transport: where the autonomy is, see transport.py; by default, in the diagram.

    Raises:
        UserError: if something the scenario names cannot be had, or the recording
            cannot be written.
    """
    builder = DiagramBuilder()
    simulation = builder.AddSystem(MakeSimulation(scenario, meshcat))
    try:
        autonomy = (transport or InProcess()).AddToBuilder(builder, scenario, simulation)
    except RuntimeError as e:  # only systems of the scenario can have such ports
        raise UserError(
            f"The ports of the systems do not fit: {' '.join(str(e).split())}"
        ) from None
    if output_dir is not None:
        writer = builder.AddNamedSystem("gate_map_writer", GateMapWriter(directory=output_dir))
        builder.Connect(autonomy.GetOutputPort("gate_map"), writer.GetInputPort("gate_map"))
        AddRecorder(builder, scenario, simulation, autonomy, output_dir)
    if meshcat is not None:
        AddVisualization(builder, scenario, simulation, autonomy, meshcat)
    outputs = [
        (simulation, "truth.referee_status"),
        (simulation, "truth.state"),
        (autonomy, "explorer_status"),
        (autonomy, "gate_map"),
        (autonomy, "lap_plan"),
        (autonomy, "rotor_losses"),
    ]
    if simulation.HasOutputPort("truth.gate_shifts"):
        outputs.append((simulation, "truth.gate_shifts"))
    for source, name in outputs:
        builder.ExportOutput(source.GetOutputPort(name), name)
    diagram = builder.Build()
    diagram.set_name("race")
    return diagram


def run_race(
    scenario: Scenario,
    output_dir: Path,
    *,
    meshcat=None,
    show=lambda record, look: None,
    transport=None,
) -> dict:
    """Flies a race and leaves its files.

    Ctrl-C and SIGTERM end the race at the next look; they and an exception in
    any system still leave every file, with what was flown.

    Args:
        scenario: the race.
        output_dir: an existing folder.
        meshcat: a Meshcat to show the race in, or None.
        show: called at every look with the RaceResult and a namespace of
            ``time`` (s), ``laps_ended`` and the values of the race's outputs.
        transport: where the autonomy is; see MakeRace().

    Returns:
        what race.json holds.

    Raises:
        UserError: if something the scenario names cannot be had, or a file
            cannot be written.
    """
    transport = transport or InProcess()
    race = MakeRace(scenario, output_dir, meshcat, transport)
    simulator = Simulator(race)
    ApplySimulatorConfig(scenario.simulator_config, simulator)
    record = RaceResult(scenario, load_track(scenario.track), transport.simulation)
    controls = None
    if meshcat is not None and isinstance(transport, InProcess):  # others keep their own time
        controls = RaceControls(meshcat, simulator, view_director(race))
    clock = time.perf_counter()

    def save(reason):
        wall = transport.wall(simulator)
        data = record.data(time.perf_counter() - clock, reason, wall)
        write_json(output_dir / "race.json", data)
        return data

    def save_map():
        race.ForcedPublish(simulator.get_context())

    def save_recording():
        close_recording(race)

    def save_replay():
        if meshcat is not None:
            meshcat.StopRecording()
            meshcat.PublishRecording()
            end_live_view(race, meshcat)
            write_text(output_dir / "race.html", meshcat.StaticHtml())

    with _interrupt_flag() as interrupted:
        # From here on, whatever happens, every file is there and valid.
        write_text(output_dir / "scenario.yaml", scenario_yaml(scenario))
        write_map(output_dir, GateMap())
        save("not over yet")
        try:
            if meshcat is not None:
                moving = scenario.disturbances.gate_shift > 0.0
                meshcat.StartRecording(
                    frames_per_second=_REPLAY_RATE_OF_MOVING_GATES if moving else _REPLAY_RATE,
                    set_visualizations_while_recording=True,
                )
            simulator.Initialize()
            transport.begin(simulator)
            outputs = (race.get_output_port(i) for i in range(race.num_output_ports()))
            ports = {port.get_name().removeprefix("truth."): port for port in outputs}
            looks, stuck = 0, None
            while not record.report.over and not interrupted.is_set and not stuck:
                looks += 1
                stuck = transport.advance(simulator, looks * LOOK_PERIOD)
                follow_gates(race.GetSubsystemByName("simulation"), simulator.get_mutable_context())
                look = _look(ports, simulator.get_context())
                look.referee_status = transport.judged(look.referee_status, simulator)
                look.laps_ended = record.observe(
                    look.time,
                    look.referee_status,
                    look.explorer_status,
                    look.gate_map,
                    look.lap_plan,
                    look.rotor_losses,
                    getattr(look, "gate_shifts", None),
                )
                if look.laps_ended:
                    save("not over yet")
                show(record, look)
                if controls is not None:
                    controls.steer(lambda: interrupted.is_set)
        except BaseException:
            # What ended the race is what the caller must learn, even if what
            # is wrong keeps a file from being brought up to date as well.
            reason = "interrupted" if interrupted.is_set else "stopped by an error"
            for step in (
                lambda: save(reason),
                save_map,
                save_recording,
                save_replay,
                lambda: transport.end(simulator),
            ):
                with contextlib.suppress(Exception):
                    step()
            raise
        transport.end(simulator)
        data = save(stuck or "interrupted")
        save_map()
        save_recording()
        save_replay()
        return data


def _look(ports: dict, context) -> types.SimpleNamespace:
    """Returns the time and the values of the race's output ports, by name."""
    values = {name: port.Eval(context) for name, port in ports.items()}
    return types.SimpleNamespace(time=context.get_time(), **values)


@contextlib.contextmanager
def _interrupt_flag():
    """Turns the first Ctrl-C or SIGTERM into a flag, so that no step is torn."""
    flag = types.SimpleNamespace(is_set=False)
    previous = {}

    def set_flag(signum, frame):
        flag.is_set = True
        signal.signal(signum, previous[signum])  # a second one means it

    try:
        for signum in (signal.SIGINT, signal.SIGTERM):
            previous[signum] = signal.signal(signum, set_flag)
    except ValueError:
        pass  # not in the main thread: signals go elsewhere
    try:
        yield flag
    finally:
        for signum, handler in previous.items():
            signal.signal(signum, handler)
