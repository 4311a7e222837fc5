"""What the camera saw in front of each gate of the best lap."""

import base64
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np

from airrace.analysis.along_lap import best_lap, gate_times
from airrace.analysis.log import read_log
from airrace.analysis.signals import seconds
from airrace.recording.pictures import decoded
from airrace.recording.writer import FILE

if TYPE_CHECKING:
    from airrace.analysis.run import Run

_LONGEST = 2.5  # s before a gate
_SAME = 1e-6  # s: stamps of pictures are in nanoseconds
_WIDTH, _QUALITY = 320, 75  # px; of JPEG


class GatePicture(NamedTuple):
    """A picture in front of a gate."""

    gate: int  #: its number
    before: float  #: how long before the gate was crossed (s)
    #: Whether a marker of the gate was read in it; None if nothing is known of what was read.
    seen: bool | None
    jpeg: bytes  #: its bytes

    @property
    def url(self) -> str:
        """The picture itself as the address of an <img>."""
        return "data:image/jpeg;base64," + base64.b64encode(self.jpeg).decode()


def gate_pictures(run: "Run") -> list[GatePicture]:
    """Returns a recorded picture in front of each gate of the best lap.

    It is the last in which a marker of the gate was read, at most 2.5 s before the gate was
    crossed; else the last before it was crossed. Gates without a picture are left out.
    """
    best = best_lap(run)
    if best is None or not run.recorded:
        return []
    lap = run.result["laps"][best - 1]
    crossed = lap["start_s"] + gate_times(lap)[:-1]
    pictures = _pictures(run, crossed)
    times = np.array([*pictures])
    result = []
    for gate, time in enumerate(crossed, 1):
        near = times[(times < time) & (times > time - _LONGEST)].tolist()
        if near:
            seen = _times_read(run, gate)
            read = [at for at in near if np.any(np.abs(seen - at) < _SAME)]
            at = (read or near)[-1]
            if (picture := decoded(pictures[at])) is not None:
                jpeg = _smaller(picture)
                is_seen = bool(read) if len(run.detections) else None
                result.append(GatePicture(gate, float(time) - at, is_seen, jpeg))
    return result


def _pictures(run, crossed):
    """Returns the recorded JPEGs shortly before some times (s), by their times (s)."""
    messages = read_log(run.folder / FILE, ["/camera/image"])
    pictures = ((seconds(message.timestamp), message.data) for _, _, message in messages)
    return {
        time: jpeg
        for time, jpeg in pictures
        if np.any((time < crossed) & (time > crossed - _LONGEST))
    }


def _times_read(run, gate):
    """Returns the times of the images in which a marker of a gate was read (s)."""
    detections = run.detections
    return detections["time"][detections["marker"] // 4 + 1 == gate].to_numpy()


def _smaller(picture):
    """Returns the JPEG of a picture at the width of the report's strip."""
    height, width = picture.shape
    size = (_WIDTH, max(1, round(height * _WIDTH / width)))
    smaller = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return cv2.imencode(".jpg", smaller, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()
