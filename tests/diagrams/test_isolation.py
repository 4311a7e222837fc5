"""Proves that nothing named truth.* reaches Autonomy."""

import textwrap

import pytest
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, Multiplexer

from airrace.common.errors import UserError
from airrace.diagrams import race as race_module
from airrace.diagrams.race import MakeRace
from airrace.diagrams.variants import Variant, variant_of
from airrace.scenario import Scenario
from airrace.track import load_track
from airrace.visualization.live_page import LivePage

INPUTS = {
    "camera_view",
    "camera_image_time",
    "camera_info",
    "state_estimate",
    "rotor_speeds",
    "rotor_status",
}
# The only systems of Simulation whose outputs Autonomy may see.
SENSORS = {"camera", "state_estimate", "rotor_bank"}


def feeds(race):
    """Yields (consumer, input port, producer, output port) of a diagram's connections."""
    for (consumer, i), (producer, o) in race.connection_map().items():
        yield consumer, consumer.get_input_port(i), producer, producer.get_output_port(o)


def origin(system, index):
    """Returns the leaf system, and its port, that an output of a diagram comes from."""
    while hasattr(system, "get_output_port_locator"):
        system, index = system.get_output_port_locator(index)
    return system, system.get_output_port(index)


def leaves(system):
    """Yields all leaf systems of a system."""
    if hasattr(system, "GetSystems"):
        for subsystem in system.GetSystems():
            yield from leaves(subsystem)
    else:
        yield system


def check_isolation(race, inputs=frozenset(INPUTS), sensors=frozenset(SENSORS)):
    """Raises AssertionError if Autonomy sees more than a drone could."""
    autonomy = race.GetSubsystemByName("autonomy")
    names = {autonomy.get_input_port(i).get_name() for i in range(autonomy.num_input_ports())}
    assert names == inputs, f"the inputs of autonomy are {names}"
    fed = set()
    for consumer, sink, producer, source in feeds(race):
        if consumer is not autonomy:
            continue
        assert producer.get_name() == "simulation"
        assert not source.get_name().startswith("truth."), f"autonomy is fed {source.get_name()}"
        assert source.get_name() == sink.get_name()
        system, port = origin(producer, source.get_index())
        assert system.get_name() in sensors, f"{source.get_name()} comes from {system.get_name()}"
        assert port.get_name() == source.get_name()
        fed.add(sink.get_name())
    assert fed == inputs
    # Inside, nothing that could produce the truth, or asks for it.
    for system in leaves(autonomy):
        ports = [
            *(system.get_input_port(i) for i in range(system.num_input_ports())),
            *(system.get_output_port(i) for i in range(system.num_output_ports())),
        ]
        assert not any("truth" in port.get_name() for port in ports), system.get_name()
        kind = type(system).__name__
        assert kind not in ("MultibodyPlant", "SceneGraph", "Referee", "StateEstimate"), kind


def test_the_race_is_isolated(tmp_path):
    race = MakeRace(Scenario(), tmp_path)
    check_isolation(race)
    simulation = race.GetSubsystemByName("simulation")
    # The check has something to find.
    ports = (simulation.get_output_port(i) for i in range(simulation.num_output_ports()))
    outputs = {port.get_name() for port in ports}
    assert {name for name in outputs if not name.startswith("truth.")} == (
        INPUTS | {"camera_image", "camera_grey"}
    )  # for systems of one's own
    assert {"truth.state", "truth.referee_status"} <= outputs
    assert len(list(leaves(race.GetSubsystemByName("autonomy")))) == len(
        variant_of(Scenario()).systems
    )
    # What comes back is rotor speeds, and the team's word that it races.
    back = {
        sink.get_name()
        for consumer, sink, producer, _ in feeds(race)
        if producer.get_name() == "autonomy" and consumer is simulation
    }
    assert back == {"rotor_speed_command", "explorer_status"}


def test_with_vio_not_even_the_noisy_state_reaches_autonomy(tmp_path):
    race = MakeRace(Scenario(estimator="vio"), tmp_path)
    inputs = frozenset(INPUTS - {"state_estimate"} | {"imu"})
    assert not race.GetSubsystemByName("simulation").HasOutputPort("state_estimate")
    check_isolation(race, inputs, frozenset({"camera", "imu", "rotor_bank"}))
    # What systems inside read as state_estimate is what one of them integrates.
    autonomy = race.GetSubsystemByName("autonomy")
    sources = {
        producer.get_name()
        for consumer, sink, producer, source in feeds(autonomy)
        if source.get_name() in ("state_estimate", "filtered_estimate", "disturbance")
    }
    assert sources == {"strapdown_integrator"}


def test_the_race_is_isolated_with_spectators(tmp_path):
    """Truth goes to the page, and still not to Autonomy."""
    with LivePage(load_track("student-airrace")) as page:
        race = MakeRace(Scenario(), tmp_path, page)
    assert any(source.get_name() == "truth.state" for _, _, _, source in feeds(race))
    check_isolation(race)


@pytest.fixture
def cheat(tmp_path, monkeypatch):
    """A scenario whose tracker asks for an input port of the name that is set."""
    (tmp_path / "cheat_box.py").write_text(
        textwrap.dedent("""
        from airrace.systems.planning.trajectory_tracker import TrajectoryTracker

        class Cheat(TrajectoryTracker):
            port = "truth.state"

            def __init__(self, scenario):
                TrajectoryTracker.__init__(self)
                self.DeclareVectorInputPort(self.port, 13)
    """)
    )
    monkeypatch.syspath_prepend(tmp_path)
    return Scenario(systems={"trajectory_tracker": "cheat_box:Cheat"})


def test_a_box_cannot_ask_for_the_truth(cheat):
    with pytest.raises(UserError, match="truth.state.*which nothing provides"):
        MakeRace(cheat)


def test_the_check_finds_a_leak(cheat, monkeypatch):
    """If MakeAutonomy let truth.state in, MakeRace would join it by its name."""
    leaky = variant_of(Scenario()) | Variant(systems={}, inputs=("truth.state",))
    monkeypatch.setattr("airrace.diagrams.autonomy.variant_of", lambda scenario: leaky)
    race = MakeRace(cheat)
    with pytest.raises(AssertionError, match="truth.state"):
        check_isolation(race)


def test_the_check_finds_a_leak_under_another_name(monkeypatch):
    """The plant's state behind a port called state_estimate is no sensor's reading."""
    make_simulation = race_module.MakeSimulation

    def make_leaky_simulation(scenario, **options):
        simulation = make_simulation(scenario, **options)
        builder = DiagramBuilder()
        builder.AddSystem(simulation)
        truth = builder.AddSystem(Multiplexer([1, 13]))
        time = builder.AddSystem(ConstantVectorSource([0.0]))
        builder.Connect(time.get_output_port(), truth.get_input_port(0))
        builder.Connect(simulation.GetOutputPort("truth.state"), truth.get_input_port(1))
        for i in range(simulation.num_input_ports()):
            port = simulation.get_input_port(i)
            builder.ExportInput(port, port.get_name())
        for i in range(simulation.num_output_ports()):
            port = simulation.get_output_port(i)
            leaks = port.get_name() == "state_estimate"
            builder.ExportOutput(truth.get_output_port() if leaks else port, port.get_name())
        diagram = builder.Build()
        diagram.set_name("simulation")
        return diagram

    monkeypatch.setattr(race_module, "MakeSimulation", make_leaky_simulation)
    race = MakeRace(Scenario())
    with pytest.raises(AssertionError, match="state_estimate comes from"):
        check_isolation(race)
