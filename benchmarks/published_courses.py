"""Open courses of published planners, with the quadrotor that they are for.

The split-S course and its quadrotor are those of Foehn, Romero and Scaramuzza, "Time-optimal
planning for quadrotor waypoint flight" (Science Robotics 2021), as Qin, Michet, Chen and Liu,
"Time-optimal gate-traversing planner for autonomous drone racing" (ICRA 2024) fly it three times
from a start to a goal: race_uzh_19wp.yaml and cpc_quad.yaml of github.com/FSC-Lab/TOGT-Planner.
"""

import numpy as np

from airrace.trajopt.flight_limits import FlightConstraints, FlightLimits
from airrace.trajopt.gate_regions import GateRegions
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

_LAP = [
    [-1.1, -1.6, 3.6],
    [9.2, 6.6, 1.0],
    [9.2, -4.0, 1.2],
    [-4.5, -6.0, 3.5],
    [-4.5, -6.0, 0.8],
    [4.75, -0.9, 1.2],
    [-2.8, 6.8, 1.2],
]
START, GOAL = [-5.0, 4.5, 1.2], [4.75, -0.9, 1.2]
RADIUS = 0.3  # m
# Flight times that were published, or measured with the published code (s).
PUBLISHED = {"AOS": 17.91, "TOGT": 17.91, "TOGT, refined": 17.56}


def split_s(waypoints: int = 19) -> GateRegions:
    """Returns the first waypoints of three laps of the split-S course, from rest to rest."""
    return GateRegions.balls((3 * _LAP)[:waypoints], None, RADIUS, between=(START, GOAL))


def constraints() -> FlightConstraints:
    """Returns the limits of the quadrotor on its course."""
    limits = FlightLimits(QUADROTOR, max_rate=np.inf, max_axis_rates=RATES, min_lift=-np.inf)
    return FlightConstraints((), 0.0, limits, half_view=np.pi, min_height=MIN_HEIGHT)
