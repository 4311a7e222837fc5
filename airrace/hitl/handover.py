"""What pilot and navigator tell each other, as two processes of one computer.

It goes over a pair of local sockets, not over the link to the simulation: a cable that is pulled
must not part the two. Neither of them ever waits for the other: what does not fit into the
socket's buffer, since the other one is busy, is lost.
"""

import collections
import pickle
import socket
from typing import Any, NamedTuple

from airrace.hitl.link.message_socket import MessageSocket
from airrace.hitl.link.messages import EXPLORER_STATUS, GATE_MAP, POLICY_STATUS
from airrace.hitl.link.plan_messages import LAP_PLAN

# How values of ports cross, which are no vectors; those of a user's own systems are pickled.
_CODECS = {
    "explorer_status": EXPLORER_STATUS,
    "gate_map": GATE_MAP,
    "lap_plan": LAP_PLAN,
    "policy_status": POLICY_STATUS,
}


class Setup(NamedTuple):
    """What the navigator has to know to begin."""

    scenario: str  # as YAML
    lcm_url: str  # of the link to the simulation
    key: bytes | None  # of that link
    output_dir: str  # where the checkpoint and the map go
    session: int  # of the pilot's Endpoint
    briefly: bool  # see warm_up_navigator()
    duration: float  # of the flight by made-up messages, see Budget (s)


class Compiling(NamedTuple):
    """The navigator has compiled so many functions."""

    functions: int


class Playing(NamedTuple):
    """The navigator flies by made-up messages, see Budget."""


class Warm(NamedTuple):
    """The navigator listens; a second of made-up messages took it a time (s)."""

    share: float


class Ended(NamedTuple):
    """The navigator has ended, and why."""

    reason: str


class Resume(NamedTuple):
    """The navigator is to go on with the checkpoint in a folder."""

    folder: str


class Joined(NamedTuple):
    """The autonomy is in a race, and takes messages of no other."""

    race: str  # its identity


class Ready(NamedTuple):
    """The navigator's values are sound from now on."""


class States(NamedTuple):
    """What the pilot knows, for the checkpoint: see states_of()."""

    race: str  # its identity
    by_system: dict[str, tuple[list, list]]


class PortValues(NamedTuple):
    """What ports hold."""

    time: float  # simulated (s)
    # Name of a port to its value; a port that is missing has the value it had
    by_port: dict[str, Any]


Message = Setup | Compiling | Playing | Warm | Ended | Joined | Resume | Ready | States | PortValues


class QueueHandover:
    """An end in the same process; see queue_pair()."""

    def __init__(self, incoming: collections.deque, outgoing: collections.deque):
        self._incoming, self._outgoing = incoming, outgoing

    def send(self, message: Message) -> bool:
        """Sends a message; returns whether it will arrive."""
        self._outgoing.append(message)
        return True

    def receive(self) -> list[Message]:
        """Returns what has come, the oldest first."""
        return [self._incoming.popleft() for _ in range(len(self._incoming))]


def queue_pair() -> tuple[QueueHandover, QueueHandover]:
    """Returns the two ends, in one process."""
    there, back = collections.deque(), collections.deque()
    return QueueHandover(there, back), QueueHandover(back, there)


class SocketHandover:
    """An end in another process.

    Attributes:
        link: to wait for, and to close.
    """

    def __init__(self, end: socket.socket):
        """Args: end: of socket.socketpair()."""
        self.link = MessageSocket(end, most_waiting=0)

    def send(self, message: Message) -> bool:
        """Sends a message; returns whether it will arrive."""
        if isinstance(message, PortValues):
            values = {
                name: _CODECS[name].encode(value).encode() if name in _CODECS else value
                for name, value in message.by_port.items()
            }
            message = message._replace(by_port=values)
        return self.link.send(pickle.dumps(message, pickle.HIGHEST_PROTOCOL))

    def receive(self) -> list[Message]:
        """Returns what has come, the oldest first."""
        messages = [pickle.loads(data) for data in iter(self.link.receive, None)]
        for message in messages:
            if isinstance(message, PortValues):
                values = message.by_port
                for name in values.keys() & _CODECS.keys():
                    codec = _CODECS[name]
                    values[name] = codec.decode(codec.message_type.decode(values[name]))
        return messages


Handover = QueueHandover | SocketHandover  # one end
