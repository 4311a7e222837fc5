"""The link over a socket that is connected already: between a process and the one it started."""

import socket
import types
from collections.abc import Callable

from airrace.hitl.link.message_socket import MessageSocket

_LONGEST_NAME = 64


class Bus:
    """The subscriptions of what stands in for an lcm.LCM."""

    def __init__(self) -> None:
        self._subscriptions: list[types.SimpleNamespace] = []

    def subscribe(
        self, channel: str, handler: Callable[[str, bytes], object]
    ) -> types.SimpleNamespace:
        """Hands all messages of a channel to handler(channel, data)."""
        subscription = types.SimpleNamespace(
            channel=channel, handler=handler, set_queue_capacity=lambda number: None
        )
        self._subscriptions.append(subscription)
        return subscription

    def unsubscribe(self, subscription: types.SimpleNamespace) -> None:
        """Ends a subscription."""
        self._subscriptions.remove(subscription)

    def _take(self, channel: str, data: bytes) -> None:
        for subscription in self._subscriptions:
            if subscription.channel == channel:
                subscription.handler(channel, data)


class SocketBus(MessageSocket, Bus):
    """Stands in for an lcm.LCM, for two processes that share a pair of sockets.

    Each message is its channel's name, a zero byte, and the bytes of the link's message.
    """

    def __init__(self, end: socket.socket):
        """Args: end: of socket.socketpair()."""
        MessageSocket.__init__(self, end)
        Bus.__init__(self)

    def publish(self, channel: str, data: bytes) -> None:
        """Sends a message, or loses it if too much waits already."""
        self.send(channel.encode() + b"\0" + data)

    def handle_timeout(self, _: int) -> int:
        """Hands over the next message that has come; returns whether there was one."""
        message = self.receive()
        if message is None:
            return 0
        name, separator, data = message.partition(b"\0")
        if len(name) > _LONGEST_NAME or not separator:
            self.give_up()
            return 0
        self._take(name.decode(errors="replace"), data)
        return 1
