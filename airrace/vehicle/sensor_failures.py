"""Sensors, and the radio, that fail for a while."""

import dataclasses as dc
import math
from collections.abc import Iterable

IMU_FAILURES = ("lost", "nan", "stuck", "saturated")
CAMERA_FAILURES = ("dark",)
RADIO_FAILURES = ("silent",)
_MOMENT = 1e-6  # s, that only rounding makes


@dc.dataclass
class ImuFailure:
    """A while in which the gyroscope and the accelerometer fail.

    Of it there are no samples ("lost"), or they are no numbers ("nan"), or they repeat the one
    before ("stuck"), or each axis shows the end of its range ("saturated").
    """

    kind: str = "lost"  # or "nan", "stuck", "saturated"
    time: float = 0.0  # s, when it begins
    duration: float | None = None  # s; null = to the end


@dc.dataclass
class CameraFailure:
    """A while in which the camera fails."""

    kind: str = "dark"  # pictures are black
    time: float = 0.0  # s, when it begins
    duration: float | None = None  # s; null = to the end


@dc.dataclass
class RadioFailure:
    """A while in which nothing that is commanded arrives at a flight controller."""

    kind: str = "silent"  # the radio has no signal
    time: float = 0.0  # s, when it begins
    duration: float | None = None  # s; null = to the end


Failure = ImuFailure | CameraFailure | RadioFailure


def failure_at(failures: Iterable[Failure], time: float) -> str | None:
    """Returns the kind of the first of some failures that is there at a time (s), or None."""
    for failure in failures:
        duration = math.inf if failure.duration is None else failure.duration
        if failure.time - _MOMENT <= time < failure.time + duration - _MOMENT:
            return failure.kind
    return None
