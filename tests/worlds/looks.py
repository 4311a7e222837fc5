"""Looks at a race: what its events say, and events of a race that nobody flies."""

import types

import numpy as np

from airrace.recording import race_events as events
from airrace.recording.race_changes import FOR_RESULT, Changes
from airrace.recording.race_events import DRONE
from airrace.track.gate_map import GateMap
from airrace.vehicle.state import STATE_SIZE, as_state

_STILL = as_state(np.eye(STATE_SIZE)[1])  # level, at the origin


class MadeUpRace:
    """Tells sinks what changes from one look at a race that nobody flies to the next."""

    def __init__(self, *sinks: events.Sink):
        self._sinks, self._changes = sinks, Changes(FOR_RESULT, DRONE)

    def look(self, time: float, **values):
        """Shows a moment; values: of ports, those named truth. without it."""
        hidden = {f"truth.{name}": value for name, value in values.items()}
        happened = self._changes.events(time, (values | hidden).get)
        for event in (*happened, events.StateSample(time, _STILL)):
            for sink in self._sinks:
                sink(event)


class Looks(list):
    """A list of what was known at each look.

    Each has ``time``, ``state`` (13,), ``crossings`` so far, and the newest ``gate_shifts``,
    ``gate_map`` and ``plan``, None before the first.
    """

    def __init__(self):
        super().__init__()
        self._now = dict(crossings=(), gate_shifts=None, gate_map=GateMap(), plan=None)

    def take(self, event):
        match event:
            case events.GatesMoved():
                self._now["gate_shifts"] = event.shifts
            case events.MapChanged():
                self._now["gate_map"] = event.gate_map
            case events.PlanMade():
                self._now["plan"] = event.plan
            case events.GateCrossed():
                self._now["crossings"] += (event.crossing,)
            case events.StateSample():
                state = np.hstack(event.truth[1:])
                self.append(types.SimpleNamespace(time=event.time, state=state, **self._now))
