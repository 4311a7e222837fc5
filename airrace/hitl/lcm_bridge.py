"""The two ends of the link as diagrams, in the place of what is on the other side."""

from pydrake.systems.framework import Diagram, DiagramBuilder

from airrace.hitl.link.endpoint import SIMULATION
from airrace.hitl.link.image_messages import PICTURE_PORTS
from airrace.hitl.lcm_receiver import LcmReceiver
from airrace.hitl.lcm_sender import LcmSender
from airrace.systems.control.delay_compensator import DelayCompensator
from airrace.systems.mapping.gate_map_writer import GateMapWriter
from airrace.vehicle import load_vehicle


class Receivers:
    """What comes from the other side: its diagram's outputs, as far as they cross the link.

    Attributes:
        diagram: with an output port for each that crosses.
    """

    def __init__(self, rows, role: str):
        """Args: rows: the table. role: of this side."""
        builder = DiagramBuilder()
        self._receivers = [
            builder.AddNamedSystem(row.name, LcmReceiver(row))
            for row in rows
            if row.sender != role and not row.ports[0].startswith("truth.")
        ]
        for receiver in self._receivers:
            for i in range(receiver.num_output_ports()):
                port = receiver.get_output_port(i)
                builder.ExportOutput(port, port.get_name())
        self.diagram: Diagram = builder.Build()
        self._shown = {}  # channel to sequence number

    def receive(self, root_context, endpoint) -> bool:
        """Shows the newest values that have come; returns whether there was something new.

        Args:
            root_context: of the diagram that is simulated.
            endpoint: that has drained what came.
        """
        new = False
        for receiver in self._receivers:
            received = endpoint.newest(receiver.channel, root_context.get_time())
            if received is None:
                continue
            mark = (received.stamp.session, received.stamp.sequence)
            if mark != self._shown.get(receiver.channel):
                self._shown[receiver.channel] = mark
                context = receiver.GetMyMutableContextFromRoot(root_context)
                receiver.receive(context, received.value, received.stamp.time)
                new = True
        return new

    def missing(self, endpoint) -> list:
        """Returns the channels on which nothing has come yet."""
        return [r.channel for r in self._receivers if endpoint.newest(r.channel) is None]


class Senders:
    """What goes to the other side."""

    def __init__(
        self, builder: DiagramBuilder, source: Diagram, rows, role: str, endpoint, lossless: bool
    ):
        """Adds the senders to a builder, connected to a diagram's output ports.

        Args:
            builder: with source in it.
            source: the diagram of this side.
            rows: the table.
            role: of this side.
            endpoint: sends.
            lossless: see LcmSender.
        """
        self.senders = []
        for row in rows:
            if row.sender != role:
                continue
            sender = builder.AddNamedSystem(f"send_{row.name}", LcmSender(row, endpoint, lossless))
            for port in row.ports:
                builder.Connect(source.GetOutputPort(port), sender.GetInputPort(port))
            self.senders.append(sender)

    def forget(self) -> None:
        """Forgets what was sent, so that everything is sent again."""
        for sender in self.senders:
            sender.forget()

    def send(self, root_context) -> list:
        """Sends what is due; returns the senders that sent something, with its bytes."""
        sent, now = [], root_context.get_time()
        for sender in self.senders:
            if sender.is_early(now):
                continue
            sender.last_message = None
            sender.ForcedPublish(sender.GetMyContextFromRoot(root_context))
            if sender.last_message is not None:
                sent.append((sender.row.name, sender.last_message))
        return sent


def pictures_wanted(autonomy: Diagram) -> tuple:
    """Returns which of PICTURE_PORTS the systems of an autonomy use."""
    names = {
        box.get_input_port(i).get_name()
        for box in autonomy.GetSystems()
        if box.get_name() != "rectifier"
        for i in range(box.num_input_ports())
    }
    return tuple(port for port in PICTURE_PORTS if port in names)


def MakeAutonomySide(scenario, autonomy: Diagram, rows, role, endpoint, lossless: bool, output_dir):
    """Joins an Autonomy with the link, through a DelayCompensator unless it is lossless.

    Args:
        scenario: the race.
        autonomy: from MakeAutonomy().
        rows, role, endpoint, lossless: see Senders.
        output_dir: where the map is kept on disk.

    Returns:
        (diagram, receivers, senders, compensator or None).
    """
    builder = DiagramBuilder()
    builder.AddSystem(autonomy)
    receivers = Receivers(rows, role)
    builder.AddSystem(receivers.diagram)
    receivers.diagram.set_name(SIMULATION)
    systems = [receivers.diagram]
    compensator = None
    if not lossless:
        compensator = builder.AddNamedSystem(
            "delay_compensator",
            DelayCompensator(
                vehicle=load_vehicle(scenario.drone)[0], rate=scenario.controller.rate
            ),
        )
        for name, box in (
            ("state_estimate", systems[0]),
            ("rotor_speeds", systems[0]),
            ("rotor_speed_command", autonomy),
        ):
            builder.Connect(box.GetOutputPort(name), compensator.GetInputPort(name))
        systems.insert(0, compensator)
    for i in range(autonomy.num_input_ports()):
        port = autonomy.get_input_port(i)
        source = next((box for box in systems if box.HasOutputPort(port.get_name())), None)
        if source is not None:
            builder.Connect(source.GetOutputPort(port.get_name()), port)
    senders = Senders(builder, autonomy, rows, role, endpoint, lossless)
    writer = builder.AddNamedSystem("gate_map_writer", GateMapWriter(directory=output_dir))
    builder.Connect(autonomy.GetOutputPort("gate_map"), writer.GetInputPort("gate_map"))
    return builder.Build(), receivers, senders, compensator
