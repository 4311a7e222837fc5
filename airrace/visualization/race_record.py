"""What the page of a race shows: a record that grows while the race goes on."""

import base64
import collections
import json
import threading
import types
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

# Numbers of a frame: time (s), p_WB (m), quaternion w, x, y, z of R_WB, speed (m/s), thrust in
# weights of the drone, distance of the position estimate from the truth (m).
FRAME = ("time", "x", "y", "z", "qw", "qx", "qy", "qz", "speed", "thrust", "error")
# Lists of dicts with a time ``t`` (s), see RaceRecord.add().
_LISTS = EVENTS, STATUS, CROSSINGS, PLANS, MAPS, SHIFTS, ESTIMATES = (
    *("events", "status", "crossings", "plans"),
    *("maps", "shifts", "estimates"),
)
# Of all pictures: with the scene, a replay stays below 30 MB.
_PICTURE_BYTES = 14_000_000
_NEWEST = 3  # pictures that a page gets at most at once while the race goes on


# How much of a record somebody has read: bytes of its frames, and how many of each of its lists.
Cursor = Mapping[str, int]


class RaceRecord:
    """A race as its page shows it, by time.

    The race adds to it, and other threads read it; nobody waits longer than for a copy of
    what is new. All that is added is plain data: frames of numbers, see FRAME, and dicts
    that become JSON.
    """

    def __init__(self) -> None:
        """Begins without anything."""
        self._lock = threading.Lock()
        self._frames = bytearray()
        self._lists: dict[str, list[dict]] = {name: [] for name in _LISTS}
        self._pictures: list[tuple[int, dict]] = []  # with their numbers, from 1
        self._count, self._bytes, self._gap = 0, 0, 0.0
        self._over: dict | None = None

    def add_frame(self, numbers: ArrayLike) -> None:
        """Adds where the drone is; numbers: see FRAME."""
        data = np.asarray(numbers, "<f4").tobytes()
        with self._lock:
            self._frames += data

    def add(self, name: str, time: float, **values: Any) -> None:
        """Adds to a list what is so from a time (s) on.

        Args:
            name: EVENTS: ``text``. STATUS: ``state`` of the explorer, number of ``gates``,
                whether it is ``done``, and whether a plan is flown, ``racing``. CROSSINGS:
                ``gate`` and ``lap``, from 1. PLANS: first ``lap``, and ``points``, see
                packed(). MAPS: the largest ``sigma`` (m), and markers that
                ``changed``: ID, p_WM, and radii of an ellipsoid (m). SHIFTS: middles of the
                ``gates`` (m). ESTIMATES: see estimate_data().
            time: (s).
            **values: see above.
        """
        with self._lock:
            self._lists[name].append({"t": round(float(time), 3), **values})

    def add_picture(self, time: float, jpeg: bytes, markers: list[dict]) -> None:
        """Adds a picture; if all together get too large, every other one goes.

        Args:
            time: when it was taken (s).
            jpeg: the file.
            markers: found in it: ``id``, ``corners``, eight shares of width and height, and
                ``p``, where it is in world (m).
        """
        text = base64.b64encode(jpeg).decode()
        with self._lock:
            if len(self._pictures) > 1:
                (_, before), (_, newest) = self._pictures[-2:]
                if newest["t"] < before["t"] + self._gap:
                    # It was only for who watches: the new one takes its place.
                    self._bytes -= len(self._pictures.pop()[1]["jpeg"])
            self._count += 1
            self._pictures.append(
                (self._count, {"t": round(float(time), 3), "jpeg": text, "markers": markers})
            )
            self._bytes += len(text)
            if self._bytes > _PICTURE_BYTES:
                self._pictures = self._pictures[::2]
                self._bytes = sum(len(picture["jpeg"]) for _, picture in self._pictures)
                times = [picture["t"] for _, picture in self._pictures]
                self._gap = 0.9 * float(np.median(np.diff(times)))

    def end(self, time: float, result: Mapping[str, Any]) -> None:
        """Notes how the race ended; time: when (s). result: of race.json."""
        explored = result.get("exploration")  # not by a client
        over = {
            "t": round(float(time), 3),
            "finished": result["finished"],
            "reason": result["dnf_reason"],
            "exploration": explored["time_s"] if explored else result["start_s"],
        }
        with self._lock:
            self._over = over

    def since(self, cursor: Cursor = types.MappingProxyType({})) -> tuple[dict, Cursor]:
        """Returns what is new as a batch, and the cursor for the next call.

        Args:
            cursor: of the call before. With the first one, the batch is all there is, but
                only the newest of its pictures.

        Returns:
            a dict that JSON can hold: ``frames`` in base64, lists, and how the race ended;
            only what is new.
        """
        read = collections.Counter(cursor)
        with self._lock:
            batch: dict = {name: items[read[name] :] for name, items in self._lists.items()}
            newest = self._pictures[-_NEWEST:]
            batch["pictures"] = [each for number, each in newest if number > read["pictures"]]
            batch["frames"] = base64.b64encode(self._frames[read["frames"] :]).decode()
            batch["over"] = self._over if not read["over"] else None
            after = {name: len(items) for name, items in self._lists.items()}
            after |= {"frames": len(self._frames), "pictures": self._count}
            after["over"] = int(self._over is not None)
        return {name: new for name, new in batch.items() if new}, after

    def whole(self) -> dict:
        """Returns everything as one batch, with all pictures."""
        batch, _ = self.since()
        with self._lock:
            batch["pictures"] = [picture for _, picture in self._pictures]
        return batch


def script_json(data: Any) -> str:
    """Returns JSON that can stand inside of a <script> element."""
    return json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
