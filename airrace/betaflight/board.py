"""Moves the sticks of a real board, and disarms it whenever it is not sure that it may fly."""

import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from airrace.betaflight.msp import STATUS_EX, Msp, Status, Tuning, status_of
from airrace.betaflight.settings import values_of
from airrace.betaflight.sticks import Sticks
from airrace.common.errors import UserError

ARM = 0  # number of the mode
_ASK = 0.1  # s, from one question to the next
_LINK = 0.5  # s, without an answer
_STALE = 0.2  # s, without a command
_ARMING = 5.0  # s, until it is armed
_MOST_RATE = 250.0  # commands a second
_SHARE = 0.5  # of the commands that a board reads
_IN_ORDER = 0, 1, 3, 2  # where roll, pitch, yaw and throttle are on the radio


def rate_of(dump: str) -> float:
    """Returns how often a board with some settings is commanded (Hz).

    It reads one message each time that it looks at its serial ports; what comes on top waits.
    """
    hertz = values_of(dump).get("serial_update_rate_hz", "100")
    return min(_SHARE * float(hertz), _MOST_RATE)


def check_board(msp: Msp, dump: str) -> None:
    """Makes sure that a board is what its settings say, as far as commands depend on it.

    Args: msp: to it. dump: its settings, all of them.

    Raises:
        UserError: if it is another firmware, is armed, or has other settings.
    """
    firmware = msp.version()
    if not firmware.startswith("BTFL "):
        raise UserError(f"The board runs {firmware}, which is no Betaflight: connect another.")
    if msp.status().armed:
        raise UserError("The board is armed: disarm it before you begin.")
    for what, has, should in _differences(msp.tuning(), dump):
        raise UserError(
            f"The board has {what} = {has}, and the settings that you give {should}: save its "
            "`dump all` anew."
        )


def _differences(tuning: Tuning, dump: str) -> Iterator[tuple[str, object, object]]:
    """Yields what a board has otherwise than a dump says: its name, what it is, what it should."""
    values = values_of(dump)
    for name, value in tuning.values.items():
        if name in values and values[name] != value:
            yield name, value, values[name]
    if tuning.channels != _IN_ORDER:
        yield "map", tuning.channels, "AETR1234"
    arming = [each[1:] for each in tuning.ranges if each[0] == ARM]
    given = [
        (int(words[3]), int(words[4]), int(words[5]))
        for line in dump.splitlines()
        if len(words := line.split()) >= 6 and words[0] == "aux" and words[2] == "0"
        if int(words[4]) < int(words[5])
    ]
    if arming != given:
        yield "ranges that arm", arming, given


class Board:
    """What the radio of a board hears.

    Attributes:
        problem: why it does not fly any more, one sentence; None while it may. It stays.
        status: what the board said last.
    """

    def __init__(
        self,
        msp: Msp,
        sticks: Sticks,
        *,
        may_arm: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ):
        """Constructs it.

        Args:
            msp: to the board.
            sticks: of its settings.
            may_arm: whether arm() is allowed. Otherwise a person arms, with a radio of their own.
            clock: in seconds.
        """
        self.problem: str | None = None
        self.status: Status | None = None
        self._msp, self._sticks, self._clock = msp, sticks, clock
        self._may_arm = may_arm
        self._command: np.ndarray | None = None
        self._asked, self._answered = float("-inf"), clock()
        self._commanded = self._armed_at = float("inf")  # when it was first told so
        self._raised = False  # the switch that arms
        self._was_armed = False

    def arm(self) -> None:
        """Arms from now on. Raises UserError if that is not allowed."""
        if not self._may_arm:
            raise UserError("The board is not armed by airrace: add --allow_arming.")
        self._armed_at = min(self._armed_at, self._clock())

    def command(self, command: np.ndarray) -> None:
        """Takes thrust and rates, see Sticks.channels(); without new ones it soon disarms."""
        if np.isfinite(command).all():
            self._command, self._commanded = command, self._clock()

    def stop(self, reason: str) -> None:
        """Disarms for good."""
        self.problem = self.problem or reason

    def step(self) -> None:
        """Tells the board its sticks; to be called again and again, see rate_of()."""
        try:
            self._listen()
            if self.problem is None:
                self.problem = self._what_is_wrong()
            self._msp.set_raw_rc(self._channels())
        except UserError as e:
            self.stop(str(e))

    @property
    def is_disarmed(self) -> bool:
        """Whether the board says so."""
        return self.status is not None and not self.status.armed

    def _listen(self) -> None:
        now = self._clock()
        if now - self._asked >= _ASK:
            self._asked = now
            self._msp.tell(STATUS_EX)
        for frame in self._msp.heard():
            if frame.command == STATUS_EX and not frame.refused:
                self.status, self._answered = status_of(frame.payload), now
                self._was_armed |= self.status.armed

    def _what_is_wrong(self) -> str | None:
        now, armed = self._clock(), self.status is not None and self.status.armed
        if now - self._answered > _LINK:
            return f"the board has not answered for {_LINK:g} s"
        if self._was_armed and not armed:
            return "the board has disarmed"
        if now - self._commanded > _STALE:
            return f"the autonomy has commanded nothing for {_STALE:g} s"
        if now - self._armed_at > _ARMING and not armed:
            reasons = self.status.reasons if self.status else "it says nothing"
            return f"the board does not arm ({reasons})"
        return None

    def _channels(self) -> Sequence[int]:
        sticks = self._sticks
        if self.problem is not None:
            return sticks.at_rest(armed=False)
        # A board does not arm if it had a reason not to when the switch was raised.
        may = self.status is not None and not self.status.arming_disabled
        is_to_arm = self._armed_at <= self._clock()
        self._raised |= may and is_to_arm
        resting = sticks.at_rest(armed=self._raised)
        if self._command is None or (is_to_arm and not self._was_armed):
            return resting
        return [*sticks.channels(self._command)[:4], *resting[4:]]
