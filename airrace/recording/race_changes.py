"""What has changed in a race, as events."""

import functools
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np

from airrace.recording import race_events as events
from airrace.recording.json_topics import estimate_error
from airrace.recording.race_events import RaceEvent
from airrace.systems.estimation.error_state import AT
from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.systems.planning.path_clock import as_clock
from airrace.systems.sensing.contact_sensor import as_contacts
from airrace.systems.types import ExplorerEvent
from airrace.vehicle.state import as_plant_state, as_state

# What of the value of a port says whether it is new, and what that is before anything has happened.
# Over a link, the same value comes again and again as another object.
KEYS: dict[str, tuple[Callable[[Any], Any], Any]] = {
    "detections": (lambda detections: detections.time, -1.0),
    "truth.gate_shifts": (lambda shifts: shifts.tolist(), None),
    "truth.referee_status": (lambda status: (len(status.crossings), status.over), (0, False)),
    "gate_map": (lambda gate_map: gate_map, None),  # equal only to itself
    "lap_plan": (lambda plan: (plan.lap, plan.start_time), (NO_PLAN.lap, NO_PLAN.start_time)),
    "path_clock": (
        lambda clock: [as_clock(clock).delay, not as_clock(clock).is_regular],
        [0.0, False],
    ),
    "explorer_status": (
        lambda s: (s.state, s.since, len(s.events), s.reason, s.gates, s.closed_at, s.done),
        ("", 0.0, 0, "", (), None, False),
    ),
    "policy_status": (lambda status: (status.flies, status.reason), (False, "")),
    "negative_thrusts": (lambda number: number.tolist(), [0.0]),
    "rotor_losses": (lambda losses: np.flatnonzero(np.isfinite(losses)).tolist(), []),
    "truth.contacts": (lambda contacts: contacts[:2].tolist(), [0.0, 0.0]),
    "slam_state": (lambda slam: slam.time, -1.0),
}
FOR_RESULT = KEYS.keys() - {"detections", "slam_state"}
FOR_LOG = KEYS.keys() - {"policy_status", "rotor_losses", "truth.contacts", "negative_thrusts"}


class Changes:
    """What has changed at some ports since they were looked at last."""

    def __init__(self, ports: Iterable[str], drone: str, map_period: float = 0.0):
        """Args: map_period: between two maps, unless a lap has ended (s)."""
        self._keys = {port: KEYS[port][1] for port in ports}
        self._drone, self._map_period, self._map_time = drone, map_period, -np.inf

    def _new(self, port, value_of):
        """Yields the value of a port, and the key of the one before, if it is new."""
        value = value_of(port) if port in self._keys else None
        if value is not None:
            key, before = KEYS[port][0](value), self._keys[port]
            if key != before:
                self._keys[port] = key
                yield value, before

    def detections(self, time: float, value_of: Callable[[str], Any]) -> Iterator[RaceEvent]:
        """Yields the detections of a new picture; see events()."""
        for detections, _ in self._new("detections", value_of):
            yield events.DetectionsSeen(time, detections, drone=self._drone)

    def events(self, time: float, value_of: Callable[[str], Any]) -> Iterator[RaceEvent]:
        """Yields what is new at a time (s); value_of: returns a port's value, None without one."""
        new, drone = functools.partial(self._new, value_of=value_of), self._drone
        yield from self.detections(time, value_of)
        for shifts, _ in new("truth.gate_shifts"):
            yield events.GatesMoved(time, shifts)
        referee = [*new("truth.referee_status")]
        crossings = [each for status, (n, _) in referee for each in status.crossings[n:]]
        lap_ended = any(crossing.gate == 1 for crossing in crossings)
        if lap_ended or time >= self._map_time + self._map_period:
            for gate_map, _ in new("gate_map"):
                self._map_time = time
                yield events.MapChanged(time, gate_map, drone=drone)
        for plan, _ in new("lap_plan"):
            yield events.PlanMade(time, plan, drone=drone)
        for clock, _ in new("path_clock"):
            delay, goes_on = KEYS["path_clock"][0](clock)
            yield events.ClockWaits(time, delay, goes_on, drone=drone)
        for status, before in new("explorer_status"):
            entered = _states_entered(status, *before[:3])
            yield events.ExplorerChanged(time, status, entered, drone=drone)
        for status, _ in new("policy_status"):
            yield events.PolicyChanged(time, status, drone=drone)
        for number, _ in new("negative_thrusts"):
            yield events.NegativeThrusts(time, int(number[0]), drone=drone)
        for losses, before in new("rotor_losses"):
            for i in np.flatnonzero(np.isfinite(losses)):
                if i not in before:
                    yield events.RotorLost(time, int(i) + 1, float(losses[i]), drone=drone)
        for contacts, _ in new("truth.contacts"):
            count = as_contacts(contacts)
            numbers = int(count.gates), int(count.environment)
            yield events.ContactsCounted(time, *numbers, drone=drone)
        for slam, _ in new("slam_state"):
            covariance = slam.belief.covariance[: AT.gyro_bias.start, : AT.gyro_bias.start]
            covariance = covariance.astype(np.float32).astype(float)
            error = _estimate_error(value_of("truth.state"), value_of("filtered_estimate"))
            yield events.EstimateMade(time, error, covariance, slam, drone=drone)
        for crossing in crossings:
            yield events.GateCrossed(time, crossing, drone=drone)
        for status, (_, was_over) in referee:
            if status.over and not was_over:
                yield events.RaceOver(time, status, drone=drone)


def _states_entered(status, state, since, count):
    """Returns the ExplorerEvents since there was a number of them, or since a state was entered."""
    if not status.events and (status.state, status.since) != (state, since):
        # An explorer of one's own may keep no events.
        return (ExplorerEvent(status.since, status.state, status.reason),)
    entered = status.events[count:]
    if not count and entered and (entered[0].state, entered[0].time) == (state, since):
        return entered[1:]  # it was told when nothing but the state was known
    return entered


def _estimate_error(truth, filtered):
    """Returns the error of the filtered estimate, see estimate_error(); NaN if not known."""
    if truth is None or filtered is None:
        return np.full(9, np.nan)
    return estimate_error(as_plant_state(truth), as_state(filtered))
