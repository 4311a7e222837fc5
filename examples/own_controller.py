"""A controller of your own: one change to the control law, and what it is worth.

    .venv/bin/python examples/own_controller.py [LAPS]

Drag, all of that in the drone's file, decelerates the drone by 3 m/s^2 at 15 m/s.
Three controllers fly the same laps in it:

  plain      the geometric controller as it is, which knows nothing of drag;
  feedback   the same, and it leans against the acceleration that it measures and cannot explain;
  mine       plain, and it adds the drag that the reference's velocity will cause (feed-forward).

You see the tracking error: how far the drone is from where it should be. You learn how a system
of the autonomy is replaced: the scenario names what makes it, as "module:callable"; in a script,
the module is "__main__". The races are short: the map is given, so nothing is explored or seen.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import airrace
from airrace.math.quaternion import rotation_matrix
from airrace.systems.control.geometric_controller import GeometricController
from airrace.trajopt.reference import as_reference
from airrace.vehicle.state import as_state


class DragFeedForward(GeometricController):
    """The geometric controller, which also makes up for the drag on the reference.

    With the drag coefficients C1, C2 (diagonal in the body frame B) and the mass m, drag
    accelerates the drone by -R_WB (C1 + C2 |v|) R_WB^T v / m. W is the world.
    """

    def __init__(self, vehicle, rate):
        super().__init__(vehicle=vehicle, rate=rate, disturbance_rejection=False)
        self._linear = np.array(vehicle.drag.linear) / vehicle.mass  # 1/s, (3,)
        self._quadratic = np.array(vehicle.drag.quadratic) / vehicle.mass  # 1/m, (3,)

    def calc_wrench(self, reference, estimate):
        """Returns total thrust (N) and moments in B (N m), (4,).

        Args: reference: vector of a Reference, (18,). estimate: vector of a State, (14,).
        """
        reference = reference.copy()
        desired = as_reference(reference)  # views of its parts
        R_WB = rotation_matrix(as_state(estimate).quaternion)
        drag = self._linear + self._quadratic * np.linalg.norm(desired.velocity)
        desired.acceleration[:] += R_WB @ (drag * (R_WB.T @ desired.velocity))
        return super().calc_wrench(reference, estimate)


def make_mine(scenario):
    """Returns the controller; called before the race."""
    return DragFeedForward(airrace.load_vehicle(scenario.drone)[0], scenario.controller.rate)


CONTROLLERS = {  # fields of the scenario
    "plain": {"controller": {"disturbance_rejection": False}},
    "feedback": {"controller": {"disturbance_rejection": True}},
    "mine": {"systems": {"geometric_controller": "__main__:make_mine"}},
}
laps = int(sys.argv[1]) if len(sys.argv) > 1 else 2
race = dict(track="hexagon", laps=laps, map="track", renderer="none", quiet=True)
figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
for name, fields in CONTROLLERS.items():
    run = airrace.race(**race, fields={**fields, "disturbances": {"drag": 1.0}})
    if not run.result["finished"]:
        print(f"{name:9s} did not finish: {run.result['dnf_reason']}")
        continue
    error = run.tracking.query("lap > 0")
    rms = np.sqrt(np.mean(error.distance**2))
    print(f"{name:9s} tracking error {100 * rms:6.2f} cm RMS, {100 * error.distance.max():6.2f} cm")
    axes.plot(error.time - error.time.iloc[0], 100 * error.distance, label=name)
axes.set(xlabel="time since gate 1 (s)", ylabel="tracking error (cm)", ylim=(0, None))
axes.legend()
figure.savefig("own_controller.png")
print(f"Picture: {Path('own_controller.png').resolve()}")
