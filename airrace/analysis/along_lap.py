"""Laps side by side: what each did at the same place of the track.

Laps differ in length, since each cuts its corners in its own way. So the place is that on the best
lap: between two gates, the metres of any lap are stretched to those of the best.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from airrace.recording.race_json import LapJson

if TYPE_CHECKING:
    from airrace.analysis.run import Run


class LapProfile(NamedTuple):
    """A lap over the place on the track; all arrays are of one length."""

    place: np.ndarray  #: metres along the best lap, from gate 1 on, (n,)
    time: np.ndarray  #: since gate 1 (s)
    speed: np.ndarray  #: m/s
    height: np.ndarray  #: above the ground (m)
    gates: np.ndarray  #: places of gates 1, 2, ... and 1 again (m).

    def behind(self, other: "LapProfile") -> np.ndarray:
        """Returns by how much this lap is later than another one at its places (s), (n,)."""
        return self.time - np.interp(self.place, other.place, other.time)


def best_lap(run: "Run") -> int | None:
    """Returns the number of the quickest lap, the first of those; None without a lap."""
    laps = run.result["laps"]
    return min(laps, key=lambda lap: lap["time_s"])["lap"] if laps else None


def gate_times(lap: LapJson) -> np.ndarray:
    """Returns when a lap of race.json passed gates 1, 2, ... and 1 again (s since gate 1)."""
    return np.array([*lap["gate_times_s"], lap["time_s"]])


def leg_losses(run: "Run") -> dict[int, np.ndarray]:
    """Returns the time that each lap lost on each leg against the best lap.

    Returns:
        {lap: seconds from gate 1 to 2, 2 to 3, ...}, without the best lap; empty if there
        is but one lap.
    """
    best = best_lap(run)
    if best is None:
        return {}
    legs = {lap["lap"]: np.diff(gate_times(lap)) for lap in run.result["laps"]}
    return {lap: times - legs[best] for lap, times in legs.items() if lap != best}


def lap_profiles(run: "Run") -> dict[int, LapProfile]:
    """Returns the profile of each lap whose flight was recorded; empty if the best was not."""
    number = best_lap(run)
    flights = {lap["lap"]: _flight(run, lap) for lap in run.result["laps"]}
    flown = {lap: flight for lap, flight in flights.items() if flight is not None}
    best = None if number is None else flown.get(number)
    if best is None:
        return {}
    return {
        lap: flight._replace(
            place=np.interp(flight.place, flight.gates, best.gates), gates=best.gates
        )
        for lap, flight in flown.items()
    }


def _flight(run: "Run", lap: LapJson) -> LapProfile | None:
    """Returns a lap over its own metres; None if it was not recorded to its end."""
    state, gates = run.state, gate_times(lap)
    if state.empty or state["time"].iloc[-1] < lap["start_s"] + lap["time_s"]:
        return None
    since = state["time"].to_numpy() - lap["start_s"]
    inside = since[(since > 0.0) & (since < lap["time_s"])]
    time = np.union1d(inside, gates)

    def at(column):
        return np.interp(time, since, state[column].to_numpy())

    steps = np.linalg.norm(np.diff([at("x"), at("y"), at("z")], axis=1), axis=0)
    place = np.concatenate([[0.0], np.cumsum(steps)])
    return LapProfile(place, time, at("speed"), at("z"), place[np.searchsorted(time, gates)])
