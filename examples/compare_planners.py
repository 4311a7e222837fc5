"""Two planners on tracks that nobody has seen: which one is quicker, and does it finish as often?

    .venv/bin/python examples/compare_planners.py [TRACKS]

`airrace evaluate` flies each race in a process of its own, on a generated track (default: 3). Both
planners get the same tracks, so they are compared track by track: differences between pairs are
much clearer than differences between means. You see the finish rates with their 95 % intervals,
which are wide for few races, the mean laps, and a picture of the lap on each track.

So that the planners alone make the difference, and to save time, the map is given: nothing is
explored or seen. Leave out `map` and `camera` below to race from pixels.
"""

import json
import subprocess
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from airrace.common.files import run_path

tracks = int(sys.argv[1]) if len(sys.argv) > 1 else 3
PLANNERS = {"3": "minimum snap, 3-D", "optimal": "time-optimal"}
FIELDS = {"map": "track", "camera": {"renderer": "none"}}


def evaluate(planner):
    """Returns evaluation.json of some races with a planner, one of PLANNERS."""
    folder = run_path("evaluation", planner)  # runs/<UTC time>-...
    options = {
        "--trajectory": planner,
        "--tracks": tracks,
        "--laps": 1,
        "--scenario_text": json.dumps(FIELDS),  # JSON is YAML, too
        "--output": folder,
    }
    words = [str(word) for option in options.items() for word in option]
    subprocess.run([sys.executable, "-m", "airrace", "evaluate", *words], check=True)
    return json.loads((folder / "evaluation.json").read_text())


evaluations = {name: evaluate(planner) for planner, name in PLANNERS.items()}

laps = {  # one a track (s); a race that did not finish has none
    name: np.array([race["mean_lap_s"] or np.nan for race in evaluation["races"]])
    for name, evaluation in evaluations.items()
}
figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
for k, (name, evaluation) in enumerate(evaluations.items()):
    summary = evaluation["summary"]
    low, high = (100 * rate for rate in summary["finish_rate_95"])
    print(
        f"{name:18s} finished {summary['finished']} of {summary['races']} "
        f"(95 %: {low:.0f} to {high:.0f} %), mean lap {np.nanmean(laps[name]):.2f} s"
    )
    axes.bar(np.arange(tracks) + 0.4 * (k - 0.5), laps[name], width=0.4, label=name)
difference = laps["time-optimal"] - laps["minimum snap, 3-D"]
print(f"time-optimal minus minimum snap, track by track: {difference.round(2)} s")
axes.set_xticks(range(tracks), [f"seed {race['seed']}" for race in evaluation["races"]])
axes.set(ylabel="mean lap (s)")
axes.legend()
figure.savefig("compare_planners.png")
print(f"Picture: {Path('compare_planners.png').resolve()}")
