"""The state of the race as text: laps, splits at the gates, and what the drone is doing."""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import cv2
import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import Meshcat
from pydrake.systems.framework import LeafSystem

from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.systems.types import ExplorerStatus, GateCrossing, RefereeStatus
from airrace.vehicle.state import as_plant_state
from airrace.visualization.meshcat_page import LEFT, Audience
from airrace.visualization.picture import FixedPicture

_WIDTH, _LINE, _SIZE, _MARGIN = 420, 27, 18, 14  # px
_BACKGROUND = (38, 50, 62)  # RGB
_TEXT = (255, 255, 255)
_LAPS = 6  # the last so many are shown
_NONE = RefereeStatus((), False, None, None, 0)


class Moment(NamedTuple):
    """What there is to say of a race at a time.

    Attributes:
        time: in the race (s).
        speed: of the drone (m/s).
        report, status: see there.
        plans: the first lap of every plan so far.
    """

    time: float
    speed: float
    report: RefereeStatus
    status: ExplorerStatus
    plans: Collection[int] = ()


def scoreboard_lines(moment: Moment, gates: int, laps: int) -> list[str]:
    """Returns what to say about a race, line by line; a lap on an earlier lap's plan says so.

    Args:
        moment: see Moment.
        gates: of the track. laps: to fly.
    """
    time, speed, report, status, plans = moment
    now = f"{time:.1f} s    {speed:.1f} m/s"
    crossings = report.crossings
    lines = [_what(gates, laps, report, status), now]
    starts = [crossings[k].time for k in range(0, len(crossings), gates)]
    times = np.diff(starts).tolist()
    for lap, lap_time in list(enumerate(times, start=1))[-_LAPS:]:
        best = min(times[: lap - 1], default=lap_time)
        again = _again(lap, plans)
        lines.append(f"lap {lap}    {lap_time:.2f} s    {lap_time - best:+.2f}{again}")
    if crossings and not report.over:
        lines.append(f"lap {len(starts)}    {time - starts[-1]:.1f} s{_again(len(starts), plans)}")
    split = _last_split(crossings, gates, times)
    return lines + ([split] if split else [])


def _again(lap: int, plans: Collection[int]) -> str:
    """Returns words on whose plan a lap flies, if that is an earlier lap's, else ''."""
    first = max((plan for plan in plans if plan <= lap), default=lap)
    return "" if first == lap else f"    plan of lap {first}"


def _what(gates: int, laps: int, report: RefereeStatus, status: ExplorerStatus) -> str:
    if report.finished:
        return "finished"
    if report.over:
        return f"did not finish: {report.dnf_reason}"
    if not status.done:
        return f"exploring: {len(status.gates)} gates found, {status.state}"
    lap, gate = lap_and_gate(len(report.crossings), gates, laps)
    return f"racing: lap {lap} of {laps}, next gate {gate}"


def lap_and_gate(crossings: int, gates: int, laps: int) -> tuple[int, int]:
    """Returns the lap that is flown, and the next gate, after so many crossings; both from 1."""
    return min(max(crossings - 1, 0) // gates + 1, laps), crossings % gates + 1


def _last_split(crossings: Sequence[GateCrossing], gates: int, times: list[float]) -> str:
    """Returns the time at the last gate, beside that of the best lap before; '' if none."""
    if not crossings:
        return ""
    lap, gate = divmod(len(crossings) - 1, gates)
    if gate == 0:
        return ""
    split = crossings[-1].time - crossings[gates * lap].time
    text = f"gate {gate + 1}    {split:.2f} s"
    if times:
        best = gates * int(np.argmin(times))
        text += f"    {split - (crossings[best + gate].time - crossings[best].time):+.2f}"
    return text


def draw_lines(lines: Sequence[str]) -> np.ndarray:
    """Returns a board with some lines of text, RGB, (h, w, 3)."""
    height = _LINE * len(lines) + 2 * _MARGIN - 8
    image = np.full((height, _WIDTH, 3), _BACKGROUND, np.uint8)
    font = cv2.FontFace("sans")
    for k, line in enumerate(lines):
        place = (_MARGIN, _MARGIN + _LINE * k + _SIZE - 4)
        cv2.putText(image, line, place, _TEXT, font, _SIZE, 600 if k == 0 else 400)
    return image


class Scoreboard(LeafSystem):
    """Shows laps and splits as text on the page.

    .. pydrake_system::

        name: Scoreboard
        input_ports:
        - truth.state
        - truth.referee_status
        - explorer_status
        - lap_plan

    ``truth.state`` is the plant's floating-body state (13), the others a
    RefereeStatus, an ExplorerStatus and a LapPlan. Nothing is drawn if nobody watches.
    """

    def __init__(
        self, *, meshcat: Meshcat, gates: int, laps: int, audience: Audience | None = None
    ):
        """Args: meshcat: to draw in. gates: of the track. laps: to fly. audience: of the page."""
        LeafSystem.__init__(self)
        self._picture = FixedPicture(meshcat, "scoreboard", left=LEFT, top=0.72, width=0.6)
        self._gates, self._laps = gates, laps
        self._audience = audience or Audience(meshcat, 0.4)
        self._state = self.DeclareVectorInputPort("truth.state", 13)
        self._report = self.DeclareAbstractInputPort("truth.referee_status", Value[object](_NONE))
        self._status = self.DeclareAbstractInputPort(
            "explorer_status", Value[object](ExplorerStatus())
        )
        self._plan = self.DeclareAbstractInputPort("lap_plan", Value[object](NO_PLAN))
        self._plans = set()  # first laps of those so far; see PathVisualizer
        self.DeclarePeriodicPublishEvent(0.1, 0.0, self._draw)

    def _draw(self, context):
        plan = self._plan.Eval(context)
        if plan is not NO_PLAN:
            self._plans.add(plan.lap)
        if not self._audience.waits():
            return
        speed = float(np.linalg.norm(as_plant_state(self._state.Eval(context)).velocity))
        report, status = self._report.Eval(context), self._status.Eval(context)
        moment = Moment(context.get_time(), speed, report, status, self._plans)
        lines = scoreboard_lines(moment, self._gates, self._laps)
        self._picture.show(draw_lines(lines))
