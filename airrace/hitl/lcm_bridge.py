"""The autonomy's end of the link: its diagrams, joined to what comes and goes over LCM.

In lockstep there is one diagram. In real time there are two, of the pilot and of the navigator,
each with what stands for the simulation and for the other one.
"""

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from pydrake.systems.framework import Diagram, DiagramBuilder, System

from airrace.diagrams.wiring import connect_by_name, initial_values, inputs_of, outputs_of
from airrace.hitl.channels import OPTIONAL_PORTS
from airrace.hitl.lcm_sender import LcmSender
from airrace.hitl.link.endpoint import AUTONOMY, SIMULATION, Endpoint
from airrace.hitl.received_ports import LcmReceiver, ReceivedPorts
from airrace.systems.estimation.delay_compensator import DelayCompensator
from airrace.systems.mapping.gate_map_writer import GateMapWriter
from airrace.systems.planning.held_reference import HeldReference
from airrace.vehicle import load_vehicle

if TYPE_CHECKING:
    from airrace.hitl.channels import PortChannel
    from airrace.scenario import Scenario

# With `vio`, what the pilot's controller acts on is predicted: MakePilot() is given it.
PREDICTED = "filtered_estimate"
_COMPENSATED = ("state_estimate", "rotor_speeds")
_REFERENCE = "exploration_reference"


class Side(NamedTuple):
    """A diagram with its end of the link."""

    diagram: Diagram  # of all
    part: Diagram  # the autonomy in it, or the half of it
    receiver: LcmReceiver  # shows what the simulation has sent
    sender: LcmSender  # of the part's outputs
    compensator: DelayCompensator | None = None  # of the link's delay, in the pilot's
    # Shows what the other half has handed over, where there is one
    received: ReceivedPorts | None = None
    sends: tuple[str, ...] = ()  # names of the outputs of the diagram that the other half is to get


def ports_wanted(*parts: Diagram) -> tuple[str, ...]:
    """Returns which of OPTIONAL_PORTS the systems of an autonomy, or of its halves, use."""
    used = {name for part in parts for name in inputs_of(part)}
    return tuple(
        port
        for port in OPTIONAL_PORTS
        if port in used and not any(part.HasOutputPort(port) for part in parts)
    )


def MakeLockstepSide(
    scenario: "Scenario",
    autonomy: Diagram,
    channels: "Sequence[PortChannel]",
    endpoint: Endpoint,
    output_dir: Path,
) -> Side:
    """Joins an Autonomy with the link.

    Args: channels, endpoint: see LcmSender. output_dir: where the map is kept on disk.
    """
    builder = DiagramBuilder()
    builder.AddSystem(autonomy)
    simulation = builder.AddNamedSystem(SIMULATION, LcmReceiver(channels, AUTONOMY))
    connect_by_name(builder, [autonomy], outputs_of(simulation))
    sender = LcmSender(autonomy, channels, AUTONOMY, endpoint, lossless=True)
    _add_writer(builder, scenario, autonomy, output_dir)
    return Side(builder.Build(), autonomy, simulation, sender)


def MakePilotSide(
    scenario: "Scenario",
    pilot: Diagram,
    navigator: Diagram,
    channels: "Sequence[PortChannel]",
    endpoint: Endpoint,
) -> Side:
    """Joins a pilot with the link, through a DelayCompensator, and with a navigator elsewhere.

    Args:
        pilot: from MakePilot(). If it estimates where it is itself, it was given PREDICTED: the
            controller then acts on what is predicted.
        navigator: from MakeNavigator(), to know its ports by; it is not in the diagram.
        channels, endpoint: see LcmSender.
    """
    builder = DiagramBuilder()
    builder.AddSystem(pilot)
    told = pilot_inputs(pilot, navigator)
    wanted = {*inputs_of(pilot), *_COMPENSATED} - {*told}
    simulation = _add_receiver(builder, channels, wanted)
    received = builder.AddNamedSystem(
        "navigator", ReceivedPorts(initial_values(navigator, pilot, told))
    )
    compensator = builder.AddNamedSystem(
        "delay_compensator",
        DelayCompensator(
            vehicle=load_vehicle(scenario.drone)[0],
            rate=scenario.controller.rate,
            to_present=scenario.localizes,
        ),
    )
    connect_by_name(builder, [compensator], outputs_of(pilot, simulation))
    sources: list[System] = [compensator, received, simulation]
    if _REFERENCE in told:
        reference = builder.AddNamedSystem("held_reference", HeldReference())
        connect_by_name(builder, [reference], outputs_of(received))
        sources.insert(0, reference)
    connect_by_name(builder, [pilot], outputs_of(*sources))
    if pilot.HasInputPort(PREDICTED):
        builder.Connect(compensator.GetOutputPort("state_estimate"), pilot.GetInputPort(PREDICTED))
    sends = navigator_inputs(pilot, navigator)
    for name in sends:
        if name == PREDICTED and pilot.HasInputPort(PREDICTED):
            port = compensator.GetOutputPort("state_estimate")
        else:
            port = (pilot if pilot.HasOutputPort(name) else compensator).GetOutputPort(name)
        builder.ExportOutput(port, name)
    sender = LcmSender(pilot, _made_by(pilot, channels), AUTONOMY, endpoint, lossless=False)
    return Side(builder.Build(), pilot, simulation, sender, compensator, received, sends)


def MakeNavigatorSide(
    scenario: "Scenario",
    pilot: Diagram,
    navigator: Diagram,
    channels: "Sequence[PortChannel]",
    endpoint: Endpoint,
    output_dir: Path,
) -> Side:
    """Joins a navigator with the link, and with a pilot elsewhere.

    Args: see MakePilotSide() and MakeLockstepSide(); the pilot is not in the diagram.
    """
    builder = DiagramBuilder()
    builder.AddSystem(navigator)
    told = navigator_inputs(pilot, navigator)
    simulation = _add_receiver(builder, channels, {*inputs_of(navigator)} - {*told})
    received = builder.AddNamedSystem(
        "pilot", ReceivedPorts(initial_values(pilot, navigator, told))
    )
    connect_by_name(builder, [navigator], outputs_of(received, simulation))
    sends = pilot_inputs(pilot, navigator)
    for name in sends:
        builder.ExportOutput(navigator.GetOutputPort(name), name)
    _add_writer(builder, scenario, navigator, output_dir)
    made = _made_by(navigator, channels)
    sender = LcmSender(navigator, made, AUTONOMY, endpoint, lossless=False)
    return Side(builder.Build(), navigator, simulation, sender, received=received, sends=sends)


def pilot_inputs(pilot: Diagram, navigator: Diagram) -> tuple[str, ...]:
    """Returns the names of the ports that the pilot's systems get from the navigator's."""
    return tuple(name for name in inputs_of(pilot) if navigator.HasOutputPort(name))


def navigator_inputs(pilot: Diagram, navigator: Diagram) -> tuple[str, ...]:
    """Returns the names of the ports that the navigator's systems get from the pilot's side."""
    return tuple(
        name for name in inputs_of(navigator) if pilot.HasOutputPort(name) or name in _COMPENSATED
    )


def _add_receiver(
    builder: DiagramBuilder, channels: "Sequence[PortChannel]", ports: Collection[str]
) -> LcmReceiver:
    """Adds what stands for the simulation, with the channels that bring one of some ports."""
    wanted = [channel for channel in channels if any(port in ports for port in channel.ports)]
    return builder.AddNamedSystem(SIMULATION, LcmReceiver(wanted, AUTONOMY))


def _made_by(part: Diagram, channels: "Sequence[PortChannel]") -> "tuple[PortChannel, ...]":
    """Returns the channels of what a diagram makes."""
    return tuple(channel for channel in channels if part.HasOutputPort(channel.ports[0]))


def _add_writer(
    builder: DiagramBuilder, scenario: "Scenario", part: Diagram, output_dir: Path
) -> None:
    """Adds what keeps the map on disk."""
    writer = builder.AddNamedSystem(
        "gate_map_writer",
        GateMapWriter(directory=output_dir, period=scenario.perception.map_period),
    )
    builder.Connect(part.GetOutputPort("gate_map"), writer.GetInputPort("gate_map"))
