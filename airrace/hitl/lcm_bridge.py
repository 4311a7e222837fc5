"""The two ends of the link as diagrams, in the place of what is on the other side."""

from pydrake.systems.framework import Diagram, DiagramBuilder

from airrace.hitl.lcm_receiver import LcmReceiver
from airrace.hitl.lcm_sender import LcmSender
from airrace.hitl.link.endpoint import AUTONOMY, SIMULATION
from airrace.hitl.link.image_messages import PICTURE_PORTS
from airrace.systems.control.delay_compensator import DelayCompensator
from airrace.systems.mapping.gate_map_writer import GateMapWriter
from airrace.vehicle import load_vehicle


class Receivers:
    """The other side's outputs, as far as they cross the link.

    Attributes:
        diagram: with an output port for each that crosses.
    """

    def __init__(self, channels, role: str):
        """Args: channels: PortChannels of the race. role: of this side."""
        builder = DiagramBuilder()
        self._receivers = [
            builder.AddNamedSystem(channel.name, LcmReceiver(channel))
            for channel in channels
            if channel.sender != role and not channel.ports[0].startswith("truth.")
        ]
        for receiver in self._receivers:
            for i in range(receiver.num_output_ports()):
                port = receiver.get_output_port(i)
                builder.ExportOutput(port, port.get_name())
        self.diagram: Diagram = builder.Build()
        self._shown = {}  # channel to (session, sequence number)

    def receive(self, root_context, endpoint) -> None:
        """Shows the newest values that have come.

        Args:
            root_context: of the diagram that is simulated.
            endpoint: that has drained what came.
        """
        for receiver in self._receivers:
            received = endpoint.newest(receiver.channel, root_context.get_time())
            if received is None:
                continue
            mark = (received.stamp.session, received.stamp.sequence)
            if mark != self._shown.get(receiver.channel):
                self._shown[receiver.channel] = mark
                context = receiver.GetMyMutableContextFromRoot(root_context)
                receiver.receive(context, received.value, received.stamp.time)

    def are_complete(self, endpoint) -> bool:
        """Whether something has come on every channel."""
        return all(endpoint.newest(receiver.channel) for receiver in self._receivers)


class Senders:
    """What goes to the other side."""

    def __init__(
        self,
        builder: DiagramBuilder,
        source: Diagram,
        channels,
        role: str,
        endpoint,
        lossless: bool,
    ):
        """Adds the senders to a builder, connected to a diagram's output ports.

        Args:
            builder: with source in it.
            source: the diagram of this side.
            channels: PortChannels of the race.
            role: of this side.
            endpoint: sends.
            lossless: see LcmSender.
        """
        self._senders = []
        for channel in channels:
            if channel.sender == role:
                sender = LcmSender(channel, endpoint, lossless)
                builder.AddNamedSystem(f"send_{channel.name}", sender)
                for port in channel.ports:
                    builder.Connect(source.GetOutputPort(port), sender.GetInputPort(port))
                self._senders.append(sender)

    def forget(self) -> None:
        """Forgets what was sent, so that everything is sent again."""
        for sender in self._senders:
            sender.forget()

    def send(self, root_context) -> list[tuple[str, bytes]]:
        """Sends what is due; returns channel and bytes of each message."""
        return [
            (sender.channel, message)
            for sender in self._senders
            if (message := sender.send(root_context)) is not None
        ]


def pictures_wanted(autonomy: Diagram) -> tuple[str, ...]:
    """Returns which of PICTURE_PORTS the systems of an autonomy use."""
    names = {
        system.get_input_port(i).get_name()
        for system in autonomy.GetSystems()
        if system.get_name() != "rectifier"
        for i in range(system.num_input_ports())
    }
    return tuple(port for port in PICTURE_PORTS if port in names)


def MakeAutonomySide(scenario, autonomy: Diagram, channels, endpoint, lossless: bool, output_dir):
    """Joins an Autonomy with the link, through a DelayCompensator unless it is lossless.

    Args:
        scenario: the race.
        autonomy: from MakeAutonomy().
        channels, endpoint, lossless: see Senders.
        output_dir: where the map is kept on disk.

    Returns:
        (diagram, receivers, senders, compensator or None).
    """
    builder = DiagramBuilder()
    builder.AddSystem(autonomy)
    receivers = Receivers(channels, AUTONOMY)
    simulation = builder.AddSystem(receivers.diagram)
    simulation.set_name(SIMULATION)
    sources, compensator = [simulation], None
    if not lossless:
        vehicle = load_vehicle(scenario.drone)[0]
        compensator = DelayCompensator(vehicle=vehicle, rate=scenario.controller.rate)
        builder.AddNamedSystem("delay_compensator", compensator)
        for name in ("state_estimate", "rotor_speeds", "rotor_speed_command"):
            source = autonomy if name == "rotor_speed_command" else simulation
            builder.Connect(source.GetOutputPort(name), compensator.GetInputPort(name))
        sources.insert(0, compensator)
    for i in range(autonomy.num_input_ports()):
        port = autonomy.get_input_port(i)
        source = next((each for each in sources if each.HasOutputPort(port.get_name())), None)
        if source is not None:
            builder.Connect(source.GetOutputPort(port.get_name()), port)
    senders = Senders(builder, autonomy, channels, AUTONOMY, endpoint, lossless)
    writer = builder.AddNamedSystem("gate_map_writer", GateMapWriter(directory=output_dir))
    builder.Connect(autonomy.GetOutputPort("gate_map"), writer.GetInputPort("gate_map"))
    return builder.Build(), receivers, senders, compensator
