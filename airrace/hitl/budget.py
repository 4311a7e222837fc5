"""What pilot and navigator take of a computer, beside what there is: whether it is fast enough."""

import collections
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from rich.table import Table

from airrace.common import jit
from airrace.common.errors import UserError
from airrace.common.processes import ending, processors
from airrace.hitl.handover import Compiling, Ended, Message, Playing, Warm
from airrace.hitl.warm_up import play_pilot, warm_up_pilot

if TYPE_CHECKING:
    from airrace.hitl.navigator_process import NavigatorProcess
    from airrace.scenario import Scenario

_RESERVE = 0.2  # of the time, for what comes on top: planning, other programs
_RATES = (1.0, 0.8, 0.5, 0.4, 0.3, 0.2, 0.1, 0.05)  # that --realtime_rate is advised to be


class Budget(NamedTuple):
    """What a second of flight takes."""

    # pilot, navigator: time that each takes for it (s)
    pilot: float
    navigator: float
    tick: float  # in which the pilot answers but for once in a thousand times (s)
    processors: int  # that there are

    @property
    def needed(self) -> float:
        """Time for a second of flight (s): with two processors, both halves work at a time."""
        if self.processors > 1:
            return max(self.pilot, self.navigator)
        return self.pilot + self.navigator

    @property
    def rate(self) -> float:
        """The highest --realtime_rate that leaves a reserve, of some round ones."""
        fitting = (rate for rate in _RATES if rate * self.needed <= 1.0 - _RESERVE)
        return next(fitting, _RATES[-1])

    def spare(self, rate: float = 1.0) -> float:
        """Returns the share of the time that is left at a --realtime_rate; negative: none is."""
        return 1.0 - rate * self.needed

    def verdict(self, rate: float = 1.0) -> str:
        """Returns in words whether races run at a --realtime_rate, or at which they do."""
        spare = self.spare(rate)
        if spare < _RESERVE:
            pace = "real time" if rate == 1.0 else f"--realtime_rate {rate:g}"
            what = "leaves no reserve" if spare > 0.0 else "is too much"
            return (
                f"{pace} {what} for this computer: end other programs, or race "
                f"with --realtime_rate {self.rate:g}"
            )
        pace = "real time" if rate == 1.0 else f"{rate:g} x real time"
        return f"{pace} with {100 * spare:.0f} % to spare"


def make_table(budget: Budget) -> Table:
    """Returns the doctor's table."""
    table = Table(title="The autonomy", show_header=False)
    for what, number in (
        ("pilot, of a processor", f"{100 * budget.pilot:.0f} %"),
        ("navigator, of a processor", f"{100 * budget.navigator:.0f} %"),
        ("the pilot's answer, p99.9", f"{1e3 * budget.tick:.1f} ms"),
        ("processors", f"{budget.processors}"),
    ):
        table.add_row(what, number)
    return table


def prepare_halves(
    scenario: "Scenario",
    navigator: "NavigatorProcess",
    duration: float,
    briefly: bool = False,
    show: Callable[[int], object] = lambda count: None,
    poll: Callable[[], object] = lambda: None,
) -> Budget:
    """Compiles the pilot here and the navigator there, and then has both fly for a while.

    They fly by made-up messages, each as fast as it can, both at the same time.

    Args: navigator: that was started, with the same duration (s). show: called with the number of
    functions that were compiled, here or there. poll: called while it waits.

    Raises UserError if the navigator cannot begin.
    """
    with jit.watched(show):
        warm_up_pilot(scenario, briefly)
    said = collections.deque[Message]()
    _wait_for(navigator, said, Playing, show, poll)
    spent = play_pilot(scenario, duration)
    share = _wait_for(navigator, said, Warm, show, poll).share
    return Budget(spent.sum() / duration, share, float(np.quantile(spent, 0.999)), processors())


def _wait_for[M: Message](
    navigator: "NavigatorProcess",
    said: collections.deque[Message],
    kind: type[M],
    show: Callable[[int], object],
    poll: Callable[[], object],
) -> M:
    """Waits until the navigator sends a message of a kind; returns it.

    Args: said: what it has sent and nobody has looked at. A navigator that is the first to be warm
    has sent all by the time that the pilot looks.
    """
    while True:
        said.extend(navigator.receive())
        while said:
            message = said.popleft()
            if isinstance(message, kind):
                return message
            if isinstance(message, Compiling):
                show(message.functions)
            elif isinstance(message, Ended):
                raise UserError(message.reason)
        if (code := navigator.poll()) is not None:
            raise UserError(f"The navigator {ending(code)} before the race.")
        poll()
