"""Laps of a track, planned without flying them: minimum snap and time-optimal.

    .venv/bin/python examples/plan_a_lap.py [TRACK] [MAX_SPEED] [MAX_ACCELERATION]

TRACK is a shipped track (default: student-airrace) or a YAML file; the limits are in m/s (20)
and m/s^2 (10). Minimum snap leads through the midpoints of the gates: 3-D plans x, y and z, and
6-D also asks for zero roll and pitch at each gate. The time-optimal lap may cross a gate anywhere
between its pylons. You see how long each lap takes, how long it is, and its speed.

Notebook 4 explains how these laps are found.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import airrace
from airrace.trajopt.feasibility import clearance_of
from airrace.trajopt.flight_limits import FlightConstraints, FlightLimits
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.min_snap.circuit import plan_circuit
from airrace.trajopt.reference import as_reference
from airrace.trajopt.time_optimal.optimal_lap import plan_optimal_circuit

track = airrace.load_track(sys.argv[1] if len(sys.argv) > 1 else "student-airrace")
max_speed = float(sys.argv[2]) if len(sys.argv) > 2 else 20.0
max_acceleration = float(sys.argv[3]) if len(sys.argv) > 3 else 10.0

vehicle, _ = airrace.load_vehicle("Default")
limits = FlightLimits(vehicle, max_speed=max_speed, max_acceleration=max_acceleration)
clearance = clearance_of(vehicle.radius)  # m, from the axis of each pylon
constraints = FlightConstraints(track.pylons()[:, :2], clearance, limits)

midpoints = np.array([gate.p_WG for gate in track.gates])  # (n, 3) m
headings = np.array([gate.heading for gate in track.gates])  # (n,) rad
half_widths = np.array([np.linalg.norm(gate.p_WL - gate.p_WR) / 2 for gate in track.gates])
# 2.5 m above and below the midpoint.
windows = GateRegions.windows(midpoints, headings, half_widths - clearance, 2.5)
laps = {
    "3-D": plan_circuit(midpoints, headings, 3, constraints),
    "6-D": plan_circuit(midpoints, headings, 6, constraints),
    "optimal": plan_optimal_circuit(windows, constraints),
}

figure, (left, right) = plt.subplots(1, 2, figsize=(12, 5), layout="constrained")
for name, lap in laps.items():
    times = np.linspace(0.0, lap.duration, 2000)
    samples = as_reference(lap.sample(times))
    speed = np.linalg.norm(samples.velocity, axis=0)  # (2000,) m/s
    length = np.linalg.norm(np.diff(samples.position), axis=0).sum()
    print(f"{name:8s} {lap.duration:6.2f} s   {length:6.1f} m   at most {speed.max():5.2f} m/s")
    left.plot(*samples.position[:2], label=name)
    right.plot(times, speed, label=f"{name}: {lap.duration:.2f} s")
for gate in track.gates:
    left.plot(*zip(gate.p_WL[:2], gate.p_WR[:2]), "o-", color="0.5")
left.set(aspect="equal", xlabel="x (m)", ylabel="y (m)", title=track.name)
right.set(xlabel="time since gate 1 (s)", ylabel="speed (m/s)", ylim=(0, None))
right.legend()
figure.savefig("plan_a_lap.png")
print(f"Picture: {Path('plan_a_lap.png').resolve()}")
