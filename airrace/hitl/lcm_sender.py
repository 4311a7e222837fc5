"""Ports whose values go over LCM."""

import numpy as np
from pydrake.systems.framework import LeafSystem

_TOLERANCE = 0.1  # of a period, by which a value may come early


class LcmSender(LeafSystem):
    """Sends the values of its input ports when they change.

    .. pydrake_system::

        name: LcmSender
        input_ports:
        - the ports of the channel

    A forced publish sends them if the first port's value is another than last
    time; in real time not more often than the channel's rate says, and once in a while
    even if it is the same, since messages get lost.
    """

    def __init__(self, channel, endpoint, lossless: bool):
        """Constructs the sender.

        Args:
            channel: a PortChannel.
            endpoint: sends the messages.
            lossless: whether every change must arrive as it is: in lockstep.
        """
        LeafSystem.__init__(self)
        self._channel, self._endpoint, self._lossless = channel, endpoint, lossless
        # How long a value waits after the last (s), by whether it is still the same.
        self._waits = {
            False: (1.0 - _TOLERANCE) / channel.rate,
            True: channel.repeat - 1e-9 if channel.repeat > 0.0 else np.inf,
        }
        for port in channel.ports:
            model = channel.model(port)
            if isinstance(model, int):
                self.DeclareVectorInputPort(port, model)
            else:
                self.DeclareAbstractInputPort(port, model)
        # What was sent is output, not state: nothing in the diagram depends on it.
        self.forget()
        self._message = None  # its bytes
        self.DeclareForcedPublishEvent(self._publish)

    @property
    def channel(self) -> str:
        """Name of the channel."""
        return self._channel.name

    def forget(self) -> None:
        """Forgets what was sent, so that everything is sent again."""
        self._sent, self._sent_at = None, -np.inf

    def send(self, root_context) -> bytes | None:
        """Sends what is due; returns the bytes of the message, or None."""
        waited = root_context.get_time() - self._sent_at
        self._message = None
        # In real time nothing is due before that, whatever the values are.
        if self._lossless or waited >= min(self._waits.values()):
            self.ForcedPublish(self.GetMyContextFromRoot(root_context))
        return self._message

    def _publish(self, context):
        first = self._channel.ports[0]
        value = self.GetInputPort(first).Eval(context)
        # What tells one value from another: cheap, and NaN is as good as any number.
        mark = value.tobytes() if isinstance(value, np.ndarray) else value
        now = context.get_time()
        if not self._is_due(mark, now):
            return
        others = {port: self.GetInputPort(port).Eval(context) for port in self._channel.ports[1:]}
        message = self._channel.encode(lossless=self._lossless, **{first: value}, **others)
        self._message = self._endpoint.publish(self._channel.name, message, now)
        self._sent, self._sent_at = mark, now

    def _is_due(self, mark, now) -> bool:
        same = mark is self._sent or (isinstance(mark, bytes) and mark == self._sent)
        if self._lossless:
            return not same
        return now - self._sent_at >= self._waits[same]
