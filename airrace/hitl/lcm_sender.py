"""Ports whose values go over LCM."""

import time

import numpy as np
from pydrake.systems.framework import LeafSystem

_TOLERANCE = 0.1  # of a period, by which a value may come early


class LcmSender(LeafSystem):
    """Sends the values of its input ports when they change.

    .. pydrake_system::

        name: LcmSender
        input_ports:
        - the ports of the row

    A forced publish sends them if the first port's value is another than last
    time; in real time not more often than the row's rate says, and once in a while
    even if it is the same, since messages get lost.
    """

    def __init__(self, row, endpoint, lossless: bool):
        """Constructs the sender.

        Args:
            row: of hitl/channels.py.
            endpoint: sends the messages.
            lossless: whether every change must arrive as it is: in lockstep.
        """
        LeafSystem.__init__(self)
        self._row = row
        self._endpoint = endpoint
        self._lossless = lossless
        # How long a value waits after the last (s), by whether it is still the same.
        self._waits = {
            False: (1.0 - _TOLERANCE) / row.rate,
            True: row.repeat - 1e-9 if row.repeat > 0.0 else np.inf,
        }
        for port in row.ports:
            model = row.model(port)
            if isinstance(model, int):
                self.DeclareVectorInputPort(port, model)
            else:
                self.DeclareAbstractInputPort(port, model)
        # What was sent is output, not state: nothing in the diagram depends on it.
        self._sent, self._sent_at, self._encode_time, self._count = None, -np.inf, 0.0, 0
        self.last_message = None  # its bytes
        self.DeclareForcedPublishEvent(self._send)

    @property
    def row(self):
        """That it sends."""
        return self._row

    @property
    def encode_time(self) -> float:
        """What encoding a message takes, on average (s)."""
        return self._encode_time / max(self._count, 1)

    def is_early(self, now: float) -> bool:
        """Whether nothing can be due at a time (s), whatever the values are."""
        return not self._lossless and now - self._sent_at < min(self._waits.values())

    def forget(self) -> None:
        """Forgets what was sent, so that everything is sent again."""
        self._sent, self._sent_at = None, -np.inf

    def _send(self, context):
        first = self._row.ports[0]
        value = self.GetInputPort(first).Eval(context)
        # What tells one value from another: cheap, and NaN is as good as any number.
        mark = value.tobytes() if isinstance(value, np.ndarray) else value
        now = context.get_time()
        if not self._is_due(mark, now):
            return
        clock = time.perf_counter()
        others = {port: self.GetInputPort(port).Eval(context) for port in self._row.ports[1:]}
        message = self._row.encode(lossless=self._lossless, **{first: value}, **others)
        self.last_message = self._endpoint.publish(self._row.name, message, now)
        self._sent, self._sent_at = mark, now
        self._encode_time += time.perf_counter() - clock
        self._count += 1

    def _is_due(self, mark, now) -> bool:
        same = mark is self._sent or (isinstance(mark, bytes) and mark == self._sent)
        if self._lossless:
            return not same
        return now - self._sent_at >= self._waits[same]
