"""What tests of a link over a pair of sockets share; the pair is the fixture ``ends``."""

from airrace.hitl.link.socket_bus import SocketBus


def drain(bus: SocketBus) -> None:
    """Hands over all messages that have come."""
    while bus.hand_over():
        pass
