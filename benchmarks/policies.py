"""Who flies the laps: the planner, or a network that has learned it.

    python -m benchmarks.policies [--tracks 20] [--levels 1 3] [--policy learned]
        [--scenario_text YAML] [--workers N] [--json FILE]

One lap on random tracks that obey the rules, a race a track, explored from pixels: a time-optimal
lap by the planner beside one by the network. A network that hands back to the planner finishes
with it: the table says how often. The margin is the distance from the nearest pylon's axis in the
lap; the energy is what the rotors do to the air, by the drone's file. The results do not depend
on the number of workers.
"""

import dataclasses as dc
import sys
import tempfile
from pathlib import Path

import numpy as np
from pydrake.systems.framework import LeafSystem

from airrace.scenario import LEARNED, NO_POLICY
from airrace.track import load_track
from airrace.trajopt.feasibility import pylon_distances
from airrace.vehicle import Vehicle, load_vehicle
from airrace.vehicle.state import STATE_SIZE
from benchmarks import harness, races
from benchmarks.harness import groups
from benchmarks.races import Case
from benchmarks.whole_race import fly_race
from tests.worlds.logged_race import LoggedInProcess

_RATE = 100.0  # Hz, of the log
_COLUMNS = {
    "": "{name}",
    "finished": "{finished} of {races}",
    "by the network alone": "{unaided}",
    "mean lap (s)": "{mean_lap_s:.2f}",
    "margin, median (m)": "{median_margin_m:.2f}",
    "least": "{least_margin_m:.2f}",
    "energy of a lap (J)": "{mean_energy_j:.0f}",
    "why not": "{reasons}",
}


def main(argv=None) -> int:
    """Flies the races and prints the table; exit code 1 if one did not finish."""
    parser = harness.make_parser(__doc__)
    parser.add_argument(
        "--tracks", type=harness.count, default=20, help="generated, a level (default: 20)"
    )
    parser.add_argument(
        "--levels", nargs="+", choices=list("0123"), default=["1", "3"], help="(default: 1 3)"
    )
    parser.add_argument(
        "--policy", default=LEARNED, help=f"{LEARNED}, or a network's .npz (default: {LEARNED})"
    )
    parser.add_argument(
        "--scenario_text", metavar="YAML", help="scenario fields on top, e.g. '{drone: StarOne}'"
    )
    parser.add_argument("--workers", type=harness.count, default=1, help="processes (default: 1)")
    return harness.run(parser, argv, measure, show)


def measure(args) -> list[dict]:
    """Returns rows of fly(), with the ``name`` of their case."""
    cases = []
    for level in args.levels:
        for name, policy in (("planner", NO_POLICY), ("network", args.policy)):
            by = dc.replace(races.lap_of_level(level, args), policy=policy)
            cases.append(Case(f"level {level}, {name}", by, range(args.tracks), True, fly))
    return races.fly_all(cases, args.workers)


class _FlightLog(LeafSystem):
    """Writes down where the drone is, and how fast its rotors turn; one row a sample.

    .. pydrake_system::

        name: _FlightLog
        input_ports:
        - truth.state
        - rotor_speeds
    """

    def __init__(self, rotors: int):
        LeafSystem.__init__(self)
        self.rows: list[np.ndarray] = []
        self._state = self.DeclareVectorInputPort("truth.state", STATE_SIZE - 1)
        self._speeds = self.DeclareVectorInputPort("rotor_speeds", rotors)
        self.DeclarePeriodicPublishEvent(1.0 / _RATE, 0.0, self._write)

    def _write(self, context):
        p_WB = self._state.Eval(context)[4:7]
        self.rows.append(np.array([context.get_time(), *p_WB, *self._speeds.Eval(context)]))


def fly(scenario_text: str, track_seed: int) -> dict:
    """Flies a race; returns its figures, see benchmarks.races.fly(), and those of its lap.

    These are ``margin_m``, ``energy_j`` (None if the lap was not finished) and ``handed_back``,
    why the network did so, empty if it did not.
    """
    with tempfile.TemporaryDirectory() as folder:
        scenario = races.scenario_of(scenario_text, track_seed, Path(folder))
        vehicle = load_vehicle(scenario.drone)[0]
        transport = LoggedInProcess(lambda _: _FlightLog(len(vehicle.rotors)))
        race = fly_race(scenario, Path(folder), transport=transport)
        pylons = load_track(scenario.track).pylons()
    events = race.get("policy", {"events": []})["events"][1:]  # the first: it takes over
    result = {
        **races.figures(scenario, race),
        "handed_back": events[0]["what"] if events else "",
        "margin_m": None,
        "energy_j": None,
    }
    for lap in race["laps"]:
        log = np.array(transport.log.rows)
        log = log[(lap["start_s"] <= log[:, 0]) & (log[:, 0] < lap["start_s"] + lap["time_s"])]
        result["margin_m"] = float(pylon_distances(log[:, 1:4].T, pylons[:, :2]).min())
        result["energy_j"] = energy(log[:, 4:], vehicle)
    return result


def energy(rotor_speeds: np.ndarray, vehicle: Vehicle) -> float:
    """Returns the integral of the rotors' torques times their speeds (J).

    Args:
        rotor_speeds: at _RATE, (N, n) rad/s.
        vehicle: that they are of.
    """
    torques = [rotor.torque_ratio * rotor.thrust_coefficient for rotor in vehicle.rotors]
    return float(np.sum(np.abs(rotor_speeds) ** 3 @ torques) / _RATE)


def summary(name: str, rows: list[dict]) -> dict:
    """Returns the figures of a row of the table; rows: of fly()."""
    flown = [row for row in rows if row["margin_m"] is not None]
    margins = np.array([row["margin_m"] for row in flown])
    unaided = sum(not row["handed_back"] for row in flown)
    return races.summary(name, rows) | {
        "unaided": "-" if name.endswith("planner") else unaided,
        "median_margin_m": float(np.median(margins)) if flown else None,
        "least_margin_m": float(margins.min()) if flown else None,
        "mean_energy_j": float(np.mean([row["energy_j"] for row in flown])) if flown else None,
    }


def show(rows: list[dict]) -> tuple[list, bool]:
    """Returns the table of what measure() found, and whether all races finished."""
    found = [summary(name, each) for (name,), each in groups(rows, "name")]
    table = harness.make_table("One lap on generated tracks, a race a track", found, _COLUMNS)
    return [table], all(row["finished"] for row in rows)


if __name__ == "__main__":
    sys.exit(main())
