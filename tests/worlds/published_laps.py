"""The gates through which laps are planned, with published lap times to compare with."""

from typing import NamedTuple

import numpy as np

from airrace.track import Track, load_track
from airrace.track.generator import generate_track
from airrace.trajopt.flight_limits import FlightConstraints
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.time_optimal.point_mass import PointMassBound, point_mass_bound

ORIGINAL = {"max_speed": 20.0, "max_acceleration": 10.0}  # m/s, m/s^2
LIMITS = {"original": ORIGINAL, "rotor": {}}
BALL, WINDOW = 0.4, (3.2, 2.5)  # m
CLEARANCE = 5.0 - WINDOW[0]  # m, from the pylons' axes: it leaves the window and no more


class PointMassLimits(NamedTuple):
    """Limits of a point mass, in the place of FlightLimits; infinite for none.

    Attributes:
        max_speed: (m/s). max_acceleration: without gravity (m/s^2).
        max_specific_force: greatest thrust over mass (m/s^2); one of the last two must be finite.
    """

    max_speed: float = np.inf
    max_acceleration: float = np.inf
    max_specific_force: float = np.inf


class PointMassCase(NamedTuple):
    """Lap times of a point mass on the track student-airrace, as published.

    Attributes:
        name: of the limits.
        limits: those of PointMassLimits.
        midpoints, windows: lap times through those (s).
    """

    name: str
    limits: dict
    midpoints: float
    windows: float


POINT_MASS_CASES = (
    PointMassCase("20 m/s, 10 m/s^2", ORIGINAL, 20.75, 18.75),
    PointMassCase(
        "20 m/s, 34 N for 1 kg", {"max_speed": 20.0, "max_specific_force": 34.0}, 19.27, 18.16
    ),
    PointMassCase(
        "20 m/s, 68 N for 3 kg", {"max_speed": 20.0, "max_specific_force": 68.0 / 3}, 19.34, 18.20
    ),
    PointMassCase("34 N for 1 kg", {"max_specific_force": 34.0}, 10.29, 9.34),
    PointMassCase("68 N for 3 kg", {"max_specific_force": 68.0 / 3}, 12.96, 11.75),
)


class Course(NamedTuple):
    """What a lap planner is told of a track with n gates.

    Attributes:
        midpoints: of the gates, (n, 3) m.
        headings: of flight, (n,) rad.
        pylons: axes, (2n, 2) m.
    """

    midpoints: np.ndarray
    headings: np.ndarray
    pylons: np.ndarray

    @classmethod
    def of(cls, track: Track) -> "Course":
        """Returns the course of a track."""
        return cls(
            np.array([gate.p_WG for gate in track.gates]),
            np.array([gate.heading for gate in track.gates]),
            track.pylons()[:, :2],
        )


def load_course(seed: int | None = None) -> Course:
    """Returns the track student-airrace, or the generated track of a seed."""
    return Course.of(load_track("student-airrace") if seed is None else generate_track(seed))


def regions(kind: str, midpoints, headings, window=WINDOW) -> GateRegions:
    """Returns gates to be crossed in "balls" or "windows", or at their "midpoints"."""
    if kind == "windows":
        return GateRegions.windows(midpoints, headings, *window)
    return GateRegions.balls(midpoints, headings, BALL if kind == "balls" else 0.0)


def exact_bound(gates, limits: PointMassLimits, pylons=(), clearance=0.0) -> PointMassBound:
    """Returns the lap of a point mass, more exactly than planners need it."""
    return point_mass_bound(gates, FlightConstraints(pylons, clearance, limits), 32, 1e-4)
