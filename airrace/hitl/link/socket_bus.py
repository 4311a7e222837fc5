"""The link over a socket that is connected already: between a process and the one it started."""

import socket

from airrace.hitl.link.bus import Bus
from airrace.hitl.link.message_socket import MessageSocket

_LONGEST_NAME = 64


class SocketBus(MessageSocket, Bus):
    """For two processes that share a pair of sockets.

    Each message is its channel's name, a zero byte, and the bytes of the link's message.
    """

    def __init__(self, end: socket.socket):
        """Args: end: of socket.socketpair()."""
        MessageSocket.__init__(self, end)
        Bus.__init__(self)

    def publish(self, channel: str, data: bytes) -> None:
        """Sends a message, or loses it if too much waits already."""
        self.send(channel.encode() + b"\0" + data)

    def hand_over(self) -> bool:
        message = self.receive()
        if message is None:
            return False
        name, separator, data = message.partition(b"\0")
        if len(name) > _LONGEST_NAME or not separator:
            self.give_up()
            return False
        self._take(name.decode(errors="replace"), data)
        return True
