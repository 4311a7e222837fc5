"""Whom one side of a link takes for its other side: by the race, and by what both must share."""

import dataclasses as dc
import hashlib
import itertools
import json
import math
from collections.abc import Mapping
from typing import Any

from airrace.common.patience import patient
from airrace.common.version import VERSION
from airrace.common.words import printable
from airrace.hitl.link import phases

SIMULATION, AUTONOMY = "simulation", "autonomy"  # the roles
_OF_LATE = 1.0  # s since something was heard: it still counts
# s that another race is heard before that is said: its autonomy outlives its simulation by 5.
_ELSEWHERE = 6.0
_MOST_SHARED = 64 << 10  # characters of JSON
_NOT_THERE = "nothing"


@dc.dataclass
class Partner:
    """What a side says of itself in each heartbeat; see lcmt_heartbeat.

    Attributes:
        shared: name of each field that both sides must share to its plain value; empty: any will
            do.
        url: of the link, for sentences.
    """

    race: str = ""
    shared: Mapping[str, Any] = dc.field(default_factory=dict)
    resumes: bool = False
    mode: str = ""
    rate: float = 0.0
    ports: tuple[str, ...] = ()
    url: str = ""

    def __post_init__(self) -> None:
        self.json = json.dumps(self.shared, separators=(",", ":"))
        digest = hashlib.blake2b(self.json.encode(), digest_size=8).hexdigest()
        self.digest = digest if self.shared else ""


class Partners:
    """Judges the heartbeats that one side hears.

    Attributes:
        me: the Partner that this side is.
        other: the role of the other side.
        phase: of this side, as it last said.
    """

    def __init__(self, role: str, me: Partner):
        """Args: role: of this side."""
        self.me, self.phase = me, ""
        self._role, self.other = role, AUTONOMY if role == SIMULATION else SIMULATION
        self._elsewhere = (math.inf, -math.inf)  # when another race was heard, first and last (s)
        self._differing: Any = None  # the newest heartbeat of one that must not join
        self._differed = -math.inf  # when that came (s)

    def introduce(self, message: Any, now: float) -> None:
        """Writes what this side is into a heartbeat, at a time (s)."""
        me = self.me
        message.role, message.phase = self._role, self.phase
        message.race, message.resumes, message.version = me.race, me.resumes, VERSION
        message.digest = me.digest
        message.shared = me.json if now - self._differed < _OF_LATE else ""
        message.mode, message.rate = me.mode, me.rate
        message.ports, message.num_ports = list(me.ports), len(me.ports)

    def notice(self, message: Any, now: float) -> None:
        """Takes note of a heartbeat of another session, of either role, at a time (s)."""
        if self._is_elsewhere(message):
            first, last = self._elsewhere
            self._elsewhere = first if now - last < _OF_LATE else now, now
        elif message.role == self.other and self._differs(message):
            before, self._differed = self._differing, now
            if before is None or message.shared or message.digest != before.digest:
                self._differing = message

    def admits(self, message: Any) -> bool:
        """Whether the sender of a heartbeat, of the other role, may be the other side.

        In a race nobody may but who goes on in it.
        """
        if self._differs(message):
            return False
        if self._role == AUTONOMY:
            return self.me.race in ("", message.race)
        if self.phase == phases.RACING:
            return message.resumes and message.race == self.me.race
        return message.race in ("", self.me.race)

    def objection(self, now: float) -> str | None:
        """Returns a sentence on why this side, which has no other one yet, finds none, or None."""
        first, last = self._elsewhere
        if now - last < _OF_LATE and now - first > patient(_ELSEWHERE):
            return self._another_race()
        if now - self._differed < _OF_LATE and self._differing is not None:
            return self._difference(self._differing)
        return None

    def _is_elsewhere(self, message: Any) -> bool:
        """Whether a heartbeat is of a race that this side can't be in."""
        if message.race in ("", self.me.race):
            return False
        return message.phase == phases.RACING or self.me.resumes

    def _differs(self, message: Any) -> bool:
        mine, other = (VERSION, self.me.digest), (message.version, message.digest)
        return bool(self.me.digest and message.digest) and mine != other

    def _another_race(self) -> str:
        where = f" ({self.me.url})" if self.me.url else ""
        if self.me.resumes:
            return (
                f"The race at this URL{where} is not the one of the checkpoint: start without "
                "--resume, or name the --output folder of the autonomy that has flown in it."
            )
        resume = ", or go on in it with --resume FOLDER" if self._role == AUTONOMY else ""
        return (
            f"Another race is on at this URL{where}: wait for its end or give another "
            f"--lcm_url{resume}."
        )

    def _difference(self, message: Any) -> str | None:
        if message.version != VERSION:
            return (
                f"The {self.other} is of airrace {message.version[:40]}, here is {VERSION}: "
                "give both the same version."
            )
        if not message.shared:
            return None  # it says so in a moment
        return (
            f"The {self.other} has another scenario: {first_difference(message.shared, self.me)}; "
            "start both with the same one."
        )


def first_difference(text: str, me: Partner) -> str:
    """Returns the first field in which the JSON of the other side differs, with both values."""
    try:
        if len(text) > _MOST_SHARED:
            raise ValueError
        theirs = json.loads(text)
        if not isinstance(theirs, dict):
            raise ValueError
    except (ValueError, TypeError, RecursionError):
        return "what it says of it cannot be read"
    for name in itertools.chain(me.shared, sorted(theirs.keys() - me.shared.keys())):
        values = [values.get(name, _NOT_THERE) for values in (theirs, me.shared)]
        there, here = (v if isinstance(v, str) else json.dumps(v) for v in values)
        if there != here:
            return printable(f"{name[:60]} {there[:60]}, here {here[:60]}")
    return "the order of its fields"
