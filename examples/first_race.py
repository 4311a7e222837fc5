"""A first race: the drone explores a track that it has never seen, maps it, and races a lap.

    .venv/bin/python examples/first_race.py [TRACK] [SEED]

TRACK is a shipped track (default: hexagon) or a YAML file. While it flies, the terminal says
what the explorer does, and why. At the end you see the lap times, and a picture of the path
from above: dashed while exploring, then coloured by speed. Where does the drone brake?

A race leaves a folder in ./runs. `airrace.race()` returns a Run, which has a table (a pandas
DataFrame) of every signal; `run.result` is race.json. The same seed gives the same race.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt

import airrace
from airrace.analysis.figure_style import SPEED_COLORS

track = sys.argv[1] if len(sys.argv) > 1 else "hexagon"
seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
run = airrace.race(track=track, laps=1, seed=seed)
if not run.result["finished"]:
    sys.exit(f"The drone did not finish: {run.result['dnf_reason']}")

for lap in run.laps.itertuples():
    print(f"lap {lap.lap}: {lap.duration:.2f} s, at most {lap.max_speed:.1f} m/s")
marker_errors = run.map.groupby("marker").error.last()  # m, at the end of the race
print(f"error of the map: {100 * marker_errors.mean():.2f} cm, mean of its markers")

exploring, racing = run.state[run.state.lap == 0], run.state[run.state.lap == 1]
figure, axes = plt.subplots(figsize=(8, 6), layout="constrained")
axes.plot(exploring.x, exploring.y, "--", color="0.6", lw=1, label="exploring")
colors = dict(cmap=SPEED_COLORS, vmin=0.0, vmax=20.0)  # m/s: from none to the limit
dots = axes.scatter(racing.x, racing.y, c=racing.speed, s=4, **colors)
for number, gate in enumerate(run.track.gates, start=1):
    axes.plot(*zip(gate.p_WL[:2], gate.p_WR[:2]), "o-", color="0.3")  # its two pylons
    axes.annotate(f" {number}", gate.p_WR[:2])
axes.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")
figure.legend(loc="outside upper right")
figure.colorbar(dots, label="speed (m/s)")
figure.savefig("first_race.png")
print(f"Picture: {Path('first_race.png').resolve()}")
