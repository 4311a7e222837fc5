"""The autonomy's end of the link: its diagram, joined to what comes and goes over LCM."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pydrake.systems.framework import Diagram, DiagramBuilder

from airrace.hitl.channels import OPTIONAL_PORTS
from airrace.hitl.lcm_receiver import LcmReceiver
from airrace.hitl.lcm_sender import LcmSender
from airrace.hitl.link.endpoint import AUTONOMY, SIMULATION, Endpoint
from airrace.scenario import VIO
from airrace.systems.control.delay_compensator import DelayCompensator
from airrace.systems.mapping.gate_map_writer import GateMapWriter
from airrace.vehicle import load_vehicle

if TYPE_CHECKING:
    from airrace.hitl.channels import PortChannel
    from airrace.scenario import Scenario

PREDICTED = "filtered_estimate"


def ports_wanted(autonomy: Diagram) -> tuple[str, ...]:
    """Returns which of OPTIONAL_PORTS the systems of an autonomy use."""
    # A rectifier has inputs for pictures that nobody may use.
    used = {
        system.get_input_port(i).get_name()
        for system in autonomy.GetSystems()
        if system.get_name() != "rectifier"
        for i in range(system.num_input_ports())
    }
    return tuple(port for port in OPTIONAL_PORTS if port in used and autonomy.HasInputPort(port))


def MakeAutonomySide(
    scenario: "Scenario",
    autonomy: Diagram,
    channels: "Sequence[PortChannel]",
    endpoint: Endpoint,
    lossless: bool,
    output_dir: Path,
) -> tuple[Diagram, LcmReceiver, LcmSender, DelayCompensator | None]:
    """Joins an Autonomy with the link, through a DelayCompensator unless it is lossless.

    Args:
        scenario: the race.
        autonomy: from MakeAutonomy(). If it estimates where it is itself, and the link is not
            lossless, it was given PREDICTED: the controller then acts on what is predicted.
        channels, endpoint, lossless: see LcmSender.
        output_dir: where the map is kept on disk.

    Returns:
        (diagram, receiver, sender, compensator or None).
    """
    builder = DiagramBuilder()
    builder.AddSystem(autonomy)
    simulation = builder.AddNamedSystem(SIMULATION, LcmReceiver(channels, AUTONOMY))
    sources, compensator = [simulation], None
    if not lossless:
        vehicle = load_vehicle(scenario.drone)[0]
        compensator = DelayCompensator(
            vehicle=vehicle, rate=scenario.controller.rate, to_present=scenario.estimator == VIO
        )
        builder.AddNamedSystem("delay_compensator", compensator)
        for name in ("state_estimate", "rotor_speeds", "rotor_speed_command"):
            source = autonomy if autonomy.HasOutputPort(name) else simulation
            builder.Connect(source.GetOutputPort(name), compensator.GetInputPort(name))
        sources.insert(0, compensator)
        if autonomy.HasInputPort(PREDICTED):
            builder.Connect(
                compensator.GetOutputPort("state_estimate"), autonomy.GetInputPort(PREDICTED)
            )
    for i in range(autonomy.num_input_ports()):
        port = autonomy.get_input_port(i)
        source = next((each for each in sources if each.HasOutputPort(port.get_name())), None)
        if source is not None:
            builder.Connect(source.GetOutputPort(port.get_name()), port)
    sender = LcmSender(autonomy, channels, AUTONOMY, endpoint, lossless)
    writer = builder.AddNamedSystem(
        "gate_map_writer",
        GateMapWriter(directory=output_dir, period=scenario.perception.map_period),
    )
    builder.Connect(autonomy.GetOutputPort("gate_map"), writer.GetInputPort("gate_map"))
    return builder.Build(), simulation, sender, compensator
