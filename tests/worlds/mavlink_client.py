"""Clients of the AI Grand Prix's interface: in this process without a network, and on UDP."""

import socket

from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pymavlink.dialects.v20 import common as mavlink

from airrace.diagrams.race import MakeRace
from airrace.mavlink.client_link import Counts
from airrace.mavlink.client_transport import ClientTransport
from airrace.mavlink.commands import ARM
from airrace.scenario import load_scenario
from airrace.vehicle.state import as_plant_state

RATES_ONLY = 128  # type_mask of SET_ATTITUDE_TARGET
VELOCITY_ONLY = 0b110111000111  # of SET_POSITION_TARGET_LOCAL_NED
POSITION_ONLY = 0b110111111000
LEVEL = [1.0, 0.0, 0.0, 0.0]


def grand_prix(text="{}", dialect="none", **mavlink_fields):
    """Returns the shipped scenario with changes, as fast as it can, without recording."""
    scenario = load_scenario(filename="grand_prix", scenario_text=text)
    scenario.simulator_config.target_realtime_rate = 0.0
    scenario.recording.content = "none"
    scenario.mavlink.dialect = dialect
    for name, value in mavlink_fields.items():
        setattr(scenario.mavlink, name, value)
    scenario.check()
    return scenario


def arm(param1=1.0):
    return mavlink.MAVLink_command_long_message(1, 1, ARM, 0, param1, *6 * [0.0])


def command(number):
    return mavlink.MAVLink_command_long_message(1, 1, number, 0, *7 * [0.0])


def rates(thrust, roll=0.0, pitch=0.0, yaw=0.0, mask=RATES_ONLY, q=LEVEL):
    return mavlink.MAVLink_set_attitude_target_message(
        0, 1, 1, mask, list(q), roll, pitch, yaw, thrust
    )


def attitude(q, thrust):
    return rates(thrust, mask=7, q=q)


def velocity(north, east, down, yaw=0.0, yaw_rate=0.0, mask=VELOCITY_ONLY, place=(0.0, 0.0, 0.0)):
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, mask, *place, north, east, down, 0.0, 0.0, 0.0, yaw, yaw_rate
    )


def position(north, east, down, mask=POSITION_ONLY, **options):
    return velocity(0.0, 0.0, 0.0, place=(north, east, down), mask=mask, **options)


def motors(*shares):
    controls = [*shares, *(8 - len(shares)) * [0.0]]
    return mavlink.MAVLink_set_actuator_control_target_message(0, 0, 1, 1, controls)


class Earpiece:
    """A link without a network: what is sent is kept, what is said comes at once.

    Attributes:
        sent: messages, oldest first. pictures: datagrams.
        answer: is called with each message that is sent; what it returns is said.
        notes: lines that were shown.
    """

    def __init__(self, answer=lambda message: ()):
        self.counts, self.messages = Counts(), []
        self.sent, self.pictures, self.answer = [], [], answer
        self.client, self.heard, self.notes = ("here", 0), True, []
        self.note = self.notes.append

    def say(self, *messages):
        self.messages += messages

    def send(self, message):
        self.sent.append(message)
        self.messages += self.answer(message)

    def send_picture(self, datagram):
        self.pictures.append(datagram)

    def drain(self):
        pass

    def wait(self, seconds):
        return False

    def take(self):
        taken, self.messages = self.messages, []
        return taken

    def of(self, kind):
        """Returns all messages of a type."""
        return [message for message in self.sent if message.get_type() == kind]


class Session:
    """A race whose client is an Earpiece, advanced by hand."""

    def __init__(self, scenario, link=None, before=None):
        self.link = link or Earpiece()
        self.transport = ClientTransport(scenario, self.link, before)
        self.diagram = MakeRace(scenario, transport=self.transport)
        self.simulator = Simulator(self.diagram)
        ApplySimulatorConfig(scenario.simulator_config, self.simulator)
        self.context = self.simulator.get_mutable_context()

    def fly(self, seconds, *messages, rate=50.0):
        """Flies on; says the messages again and again, at a rate (Hz)."""
        end = self.context.get_time() + seconds
        if not messages:
            self.simulator.AdvanceTo(end)
        while messages and self.context.get_time() < end - 1e-9:
            self.link.say(*messages)
            self.simulator.AdvanceTo(min(self.context.get_time() + 1.0 / rate, end))
        return self.state

    @property
    def state(self):
        return as_plant_state(self.output("truth.state").copy())

    def output(self, name):
        observer = self.diagram.GetSubsystemByName("race_observer")
        return observer.GetInputPort(name).Eval(observer.GetMyContextFromRoot(self.context))

    @property
    def bridge(self):
        return self.transport.bridge

    @property
    def bridge_context(self):
        return self.bridge.GetMyContextFromRoot(self.context)


class UdpClient:
    """A client that waits at a free port of loopback, as those of the official simulator do."""

    def __init__(self):
        self.socket, self.pictures = _bound(), _bound()
        self.mavlink = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self.parser = mavlink.MAVLink(None)
        self.simulator = None

    @property
    def ports(self):
        return self.socket.getsockname()[1], self.pictures.getsockname()[1]

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.socket.close()
        self.pictures.close()

    def hear(self, seconds=5.0):
        """Returns the messages of the next datagram, an empty list if none comes."""
        self.socket.settimeout(seconds)
        try:
            data, self.simulator = self.socket.recvfrom(65536)
        except TimeoutError:
            return []
        return self.parser.parse_buffer(data) or []

    def pack(self, message):
        data = message.pack(self.mavlink)
        self.mavlink.seq = (self.mavlink.seq + 1) % 256
        return data

    def say(self, *messages):
        for message in messages:
            self.send(self.pack(message))

    def send(self, data):
        self.socket.sendto(data, self.simulator)


def _bound():
    udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    udp.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 * 1024 * 1024)
    udp.bind(("127.0.0.1", 0))
    return udp
