"""What an Endpoint sends and receives by: messages of bytes on channels with names."""

from collections.abc import Callable
from typing import NamedTuple

from airrace.hitl.link.packets import MAX_SIZE


class Subscription(NamedTuple):
    """Who hears a channel."""

    channel: str
    handler: Callable[[str, bytes], object]
    max_size: int  # of a message (bytes)
    most_waiting: int  # messages; the newest


class Bus:
    """Subscriptions, and who is handed what; a kind of bus adds how messages come and go."""

    def __init__(self) -> None:
        self._subscriptions: list[Subscription] = []

    def subscribe(
        self,
        channel: str,
        handler: Callable[[str, bytes], object],
        *,
        max_size: int = MAX_SIZE,
        most_waiting: int = 100,
    ) -> Subscription:
        """Hands all messages of a channel to handler(channel, data).

        Args: max_size, most_waiting: see Subscription; of a bus that others may speak on.
        """
        subscription = Subscription(channel, handler, max_size, most_waiting)
        self._subscriptions.append(subscription)
        return subscription

    def unsubscribe(self, subscription: Subscription) -> None:
        """Ends a subscription."""
        self._subscriptions.remove(subscription)

    def hears(self, channel: str) -> bool:
        """Whether somebody hears a channel."""
        return any(each.channel == channel for each in self._subscriptions)

    def publish(self, channel: str, data: bytes) -> None:
        """Sends a message, or loses it."""
        raise NotImplementedError

    def hand_over(self) -> bool:
        """Hands over the next message that has come; returns whether there was one."""
        raise NotImplementedError

    def wait(self, timeout: float) -> None:
        """Waits until a message may have come, at most some time (s)."""
        raise NotImplementedError

    def summary(self) -> dict:
        """Returns counts of datagrams: ``received``, and ``dropped`` by reason; or nothing."""
        return {}

    def _take(self, channel: str, data: bytes) -> None:
        for subscription in self._subscriptions:
            if subscription.channel == channel:
                subscription.handler(channel, data)
