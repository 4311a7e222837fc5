"""Open courses of published planners, with the quadrotor that they are for.

The split-S course and its quadrotor are those of Foehn, Romero and Scaramuzza, "Time-optimal
planning for quadrotor waypoint flight" (Science Robotics 2021). Qin, Michet, Chen and Liu,
"Time-optimal gate-traversing planner for autonomous drone racing" (ICRA 2024), fly it from a start
to a goal, nearly three times through waypoints or gates, or once through gates of many kinds:
cpc_quad.yaml, race_uzh_19wp.yaml, race_uzh_19g.yaml and race_uzh_7g_multiprisma.yaml of
github.com/FSC-Lab/TOGT-Planner.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from airrace.trajopt.flight_limits import FlightConstraints, FlightLimits
from airrace.trajopt.gate_regions import GateRegions, Region
from airrace.vehicle import Rotor, Vehicle

_ARM = 0.15  # m, in x and in y
QUADROTOR = Vehicle(
    name="published quadrotor",
    mass=0.85,
    inertia=[0.001, 0.001, 0.0017],
    rotor_lag=0.03,  # not published: nothing here depends on it
    rotors=[
        Rotor(
            position=[x * _ARM, y * _ARM, 0.0],
            direction=direction,
            thrust_coefficient=1e-6,  # likewise
            torque_ratio=0.05,
            max_thrust=6.879,
            radius=0.1,
        )
        for x, y, direction in ((1, 1, "cw"), (1, -1, "ccw"), (-1, -1, "cw"), (-1, 1, "ccw"))
    ],
)
RATES = (15.0, 15.0, 2.99)  # rad/s, about each axis
MIN_HEIGHT = 0.3  # m

_PLACES = np.array(
    [
        [-1.1, -1.6, 3.6],
        [9.2, 6.6, 1.0],
        [9.2, -4.0, 1.2],
        [-4.5, -6.0, 3.5],
        [-4.5, -6.0, 0.8],
        [4.75, -0.9, 1.2],
        [-2.8, 6.8, 1.2],
    ]
)
_HEADINGS = np.deg2rad([0.0, -20.0, -130.0, 180.0, 0.0, 70.0, 200.0])
_BETWEEN = [-5.0, 4.5, 1.2], [4.75, -0.9, 1.2]  # start and goal
_COUNT = 19  # of three laps of seven
_RADIUS = 0.3  # m, of waypoints


def waypoints() -> GateRegions:
    """Returns waypoints to be passed within 0.3 m."""
    return _course([Region.ball(place, _RADIUS) for place in _PLACES])


def gates() -> GateRegions:
    """Returns upright squares of 1.6 m."""
    return _course([Region.window(*gate, 0.8, 0.8) for gate in zip(_PLACES, _HEADINGS)])


def shapes() -> GateRegions:
    """Returns a triangle, squares of 2.4 m, a pentagonal tunnel, a hexagon and a ball."""
    triangle = [[1.2, -1.2], [0.0, 1.2], [-1.2, -1.2]]
    pentagon, length = _regular(5, 2.0, np.pi / 2), 16.0
    forward = np.array([np.cos(_HEADINGS[2]), np.sin(_HEADINGS[2]), 0.0])
    tunnel = [_upright(2, pentagon, along) for along in length / 2 * np.outer((-1, 0, 1), forward)]
    squares = [Region.window(_PLACES[i], _HEADINGS[i], 1.2, 1.2) for i in (1, 3, 4)]
    return _course(
        [
            Region.polygon(_upright(0, triangle)),
            squares[0],
            Region.polygon(tunnel[0]),
            Region.polygon(tunnel[1], length),
            Region.polygon(tunnel[2]),
            *squares[1:],
            Region.polygon(_upright(5, _regular(6, 1.5, 0.0))),
            Region.ball(_PLACES[6], _RADIUS),
        ],
        laps=1,
    )


# By name: what makes the gates, and flight times that were published, or measured with published
# code (s). Not all of those keep the limits: of the refined ones, and of the one through 19 gates,
# the rotors or the rates are one to some per cent over.
COURSES = {
    "19-waypoints": (waypoints, {"AOS": 17.91, "TOGT": 17.91, "TOGT, refined": 17.56}),
    "19-gates": (gates, {"published": 16.83}),
    "7-shapes": (shapes, {"TOGT": 8.20, "TOGT, refined": 7.00}),
}


def constraints() -> FlightConstraints:
    """Returns the limits of the quadrotor on its courses."""
    limits = FlightLimits(QUADROTOR, max_rate=np.inf, max_axis_rates=RATES, min_lift=-np.inf)
    return FlightConstraints((), 0.0, limits, half_view=np.pi, min_height=MIN_HEIGHT)


def _course(regions: Sequence[Region], laps: int = 3) -> GateRegions:
    """Returns some laps from rest to rest, in any direction."""
    return GateRegions.of_regions((laps * [*regions])[:_COUNT], None, between=_BETWEEN)


def _upright(i: int, outline: ArrayLike, moved: ArrayLike = 0.0) -> np.ndarray:
    """Returns corners of a gate, (n, 3) m, from an outline, (n, 2) m leftwards and upwards."""
    left = [-np.sin(_HEADINGS[i]), np.cos(_HEADINGS[i]), 0.0]
    return _PLACES[i] + moved + np.asarray(outline) @ np.array([left, [0.0, 0.0, 1.0]])


def _regular(corners: int, radius: float, first: float) -> np.ndarray:
    """Returns a regular polygon, (corners, 2) m, whose first corner is at an angle (rad)."""
    angles = first + 2 * np.pi * np.arange(corners) / corners
    return radius * np.column_stack([np.cos(angles), np.sin(angles)])
