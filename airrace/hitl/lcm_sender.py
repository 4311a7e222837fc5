"""Outputs of a diagram that go over LCM."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pydrake.systems.framework import Context, Diagram

    from airrace.hitl.channels import PortChannel
    from airrace.hitl.link.endpoint import Endpoint

_TOLERANCE = 0.1  # of a period, by which a value may come early


class LcmSender:
    """Sends the values of a diagram's output ports when they change.

    The first port of a channel tells whether there is a new message: in real time not more
    often than the channel's rate says, and once in a while even if it is the same, since
    messages get lost. Nothing in the diagram depends on what was sent.
    """

    def __init__(
        self,
        source: "Diagram",
        channels: "Sequence[PortChannel]",
        role: str,
        endpoint: "Endpoint",
        lossless: bool,
    ):
        """Args: source: of this side. lossless: whether all changes must arrive as they are."""
        self._source, self._endpoint, self._lossless = source, endpoint, lossless
        self._channels = [channel for channel in channels if channel.sender == role]
        self._ports = {
            port: source.GetOutputPort(port) for channel in self._channels for port in channel.ports
        }
        self.forget()

    def forget(self) -> None:
        """Forgets what was sent, so that everything is sent again."""
        self._sent: dict[str, tuple] = {
            c.name: (None, -np.inf) for c in self._channels
        }  # mark and time (s)

    def send(self, root_context: "Context") -> list[tuple[str, bytes]]:
        """Sends what is due; returns channel and bytes of each message."""
        context, now = self._source.GetMyContextFromRoot(root_context), root_context.get_time()
        sent = []
        for channel in self._channels:
            before, at = self._sent[channel.name]
            # How long a value waits after the last (s), by whether it is still the same.
            waits = (1.0 - _TOLERANCE) / channel.rate, channel.repeat - 1e-9
            if not self._lossless and now - at < min(waits):
                continue  # whatever the values are
            first, *others = channel.ports
            value = self._ports[first].Eval(context)
            # What tells one value from another: cheap, and NaN is as good as any number.
            mark = value.tobytes() if isinstance(value, np.ndarray) else value
            same = mark is before or (isinstance(mark, bytes) and mark == before)
            if same if self._lossless else now - at < waits[same]:
                continue
            values = {first: value} | {port: self._ports[port].Eval(context) for port in others}
            message = channel.encode(lossless=self._lossless, **values)
            sent.append((channel.name, self._endpoint.publish(channel.name, message, now)))
            self._sent[channel.name] = mark, now
        return sent
