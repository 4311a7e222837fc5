"""What guards a board, as the process of the autonomy has it; see guard_process.py."""

import pickle
import subprocess
import time
from typing import NamedTuple

import numpy as np

from airrace.common.errors import UserError
from airrace.common.processes import ending
from airrace.hitl.link.message_socket import MessageSocket, start_module

_MODULE = "airrace.betaflight.guard_process"
_START = 20.0  # s, that it may take
_FAREWELL = 4.0  # s, likewise, to disarm


class Setup(NamedTuple):
    """What the guard has to know."""

    place: str  # of the board, see open_msp()
    dump: str  # its settings
    drone: str  # see load_vehicle()
    may_arm: bool


class Ready(NamedTuple):
    """The board is what it should be."""


class Arm(NamedTuple):
    """It is to be armed."""


class Armed(NamedTuple):
    """It is."""


class Stop(NamedTuple):
    """It is to be disarmed, and why."""

    reason: str


class Guard:
    """A guard's process, as who started it has it.

    Attributes:
        problem: why the board does not fly any more, one sentence; None while it may.
        is_armed: whether the board has said that it is.
    """

    def __init__(self, setup: Setup):
        """Starts it.

        Raises:
            UserError: if there is no such board, or it is not what its settings say.
        """
        self.problem: str | None = None
        self.is_armed = False
        self._may_arm = setup.may_arm
        self._process, here = start_module(_MODULE)
        self._socket = MessageSocket(here)
        self._send(setup)
        end = time.monotonic() + _START
        while not (said := self._heard()):
            self._socket.wait(0.05)
            if self._socket.is_broken or time.monotonic() > end:
                self.close()
                raise UserError("What guards the board does not start: try it again.")
        if not isinstance(said[0], Ready):
            self.close()
            raise UserError(said[0].reason)

    def arm(self) -> None:
        """Has the board armed, if that is allowed; ``is_armed`` says when it is, after a poll()."""
        if self._may_arm:
            self._send(Arm())

    def command(self, command: np.ndarray | None) -> None:
        """Hands a command over, see Sticks.channels(); None while there is none to trust."""
        if command is not None:
            self._send(np.array(command, float))

    def poll(self) -> str | None:
        """Returns ``problem``, as of now."""
        for message in self._heard():
            if isinstance(message, Stop):
                self.problem = self.problem or message.reason
            else:
                self.is_armed = True
        if self.problem is None and (code := self._process.poll()) is not None:
            self.problem = f"what guards the board {ending(code)}"
        return self.problem

    def close(self, reason: str = "it was told to") -> None:
        """Disarms, and ends it."""
        self._send(Stop(reason))
        try:
            self._process.wait(_FAREWELL)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._socket.close()

    def _send(self, message: object) -> None:
        self._socket.send(pickle.dumps(message))

    def _heard(self) -> list:
        return [pickle.loads(data) for data in iter(self._socket.receive, None)]
