"""The state of a race as text, for pictures: laps, splits at the gates, what the drone does."""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import cv2
import numpy as np

from airrace.systems.types import ExplorerStatus, GateCrossing, RefereeStatus
from airrace.visualization.terminal import lap_and_gate

_WIDTH, _LINE, _SIZE, _MARGIN = 420, 27, 18, 14  # px
_BACKGROUND = (38, 50, 62)  # RGB
_TEXT = (255, 255, 255)
_LAPS = 6  # the last so many are shown


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
