"""An open course, planned without flying it: from rest, through balls, upside down, to rest.

    .venv/bin/python examples/plan_a_course.py [RADIUS]

The drone starts at rest, dives from a high waypoint to the one below it ("split S"), and stops.
It must pass each waypoint within RADIUS (default: 0.3 m), in whatever direction. Nothing limits it
but its rotors and how fast it may turn. You see how long it takes, and how far it tilts.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import airrace
from airrace.trajopt.flight_limits import FlightConstraints, FlightLimits
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.time_optimal.optimal_course import plan_optimal_course

radius = float(sys.argv[1]) if len(sys.argv) > 1 else 0.3  # m
start, goal = [0.0, 0.0, 2.0], [4.0, -3.0, 2.0]  # m
waypoints = [[8.0, 4.0, 4.0], [-6.0, 0.0, 6.0], [-6.0, 0.0, 2.0]]  # m

vehicle, _ = airrace.load_vehicle("Default")
limits = FlightLimits(
    vehicle,
    max_axis_rates=(15.0, 15.0, 3.0),  # rad/s, about the body's axes
    min_lift=-np.inf,  # it may fly upside down
)
constraints = FlightConstraints(
    pylons=(),
    clearance=0.0,
    limits=limits,
    half_view=np.pi,  # it need not see where it flies
    min_height=0.5,  # m
)
gates = GateRegions.balls(waypoints, None, radius, between=(start, goal))
course = plan_optimal_course(gates, constraints)

states = course.states()  # at 1 kHz, or more
tilt = np.rad2deg(np.arccos(states.rotations[2, 2]))  # of the thrust's axis off the vertical
speed = np.linalg.norm(states.velocities, axis=0)  # (N,) m/s
share = states.thrusts.max() / vehicle.max_thrusts.max()
print(f"{course.duration:.3f} s, at most {speed.max():.1f} m/s, tilt {tilt.max():.0f} degrees")
print(f"rotors: at most {share:.1%} of their thrust; a point mass takes {course.bound:.3f} s")

figure, (left, right) = plt.subplots(1, 2, figsize=(12, 5), layout="constrained")
left.plot(states.positions[0], states.positions[2])
for x, _, z in waypoints:
    left.add_patch(plt.Circle((x, z), radius, color="0.7"))
left.set(aspect="equal", xlabel="x (m)", ylabel="z (m)", title="from the side")
right.plot(states.times, states.thrusts.T)
right.set(xlabel="time (s)", ylabel="thrust of each rotor (N)")
figure.savefig("plan_a_course.png")
print(f"Picture: {Path('plan_a_course.png').resolve()}")
