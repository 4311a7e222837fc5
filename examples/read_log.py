"""Reads the log of a race: its tables, and what they say about the flight.

    .venv/bin/python examples/read_log.py [FOLDER]

FOLDER is that of a race, such as runs/<time>-...; without one, a short race is flown first.
You see which tables a run has, the tracking error lap by lap, and a picture of speed, tracking
error and error of the map over time. Each table is a pandas DataFrame; what its columns are is
in `help(airrace.analysis.run.Run)`. For other programs: `airrace tables FOLDER`.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import airrace

if len(sys.argv) > 1:
    run = airrace.load_run(sys.argv[1])
else:
    print("Flying a race of two laps first")
    run = airrace.race(track="hexagon", laps=2, record="light", quiet=True)  # no pictures

print(f"{run.track.name}, {run.vehicle.name}, seed {run.scenario.seed}: {run.folder}")
for name, table in run.tables.items():
    print(f"  {name:13s} {len(table):6d} rows: {', '.join(table.columns[:7])}")

# Lap 0 is the exploration and the flight to gate 1. Its worst error is the hover height: the
# reference is there already while the drone still stands on its pad.
tracking = run.tracking[run.tracking.lap <= len(run.laps)]
errors = 100 * tracking.groupby("lap").distance.agg(
    rms=lambda d: np.sqrt(np.mean(d**2)), median="median", worst="max"
)
print("Tracking error, the distance from the reference (cm):")
print(errors.round(2).to_string())

figure, (top, middle, bottom) = plt.subplots(
    3, 1, figsize=(9, 8), sharex=True, layout="constrained"
)
top.plot(run.state.time, run.state.speed)
top.set_ylabel("speed (m/s)")
middle.semilogy(run.tracking.time, 100 * run.tracking.distance)
middle.set_ylabel("tracking error (cm)")
map_error = run.map.groupby("time").error  # of all markers that are on the map at that time
bottom.semilogy(100 * map_error.mean(), label="mean")
bottom.semilogy(100 * map_error.max(), label="worst marker")
bottom.set(xlabel="time (s)", ylabel="error of the map (cm)")
bottom.legend()
for axes in (top, middle, bottom):
    for start in run.lap_starts:  # when gate 1 was crossed
        axes.axvline(start, color="0.8", zorder=0)
figure.savefig("read_log.png")
print(f"Picture: {Path('read_log.png').resolve()}")
