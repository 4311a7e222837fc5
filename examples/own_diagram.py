"""A race in a diagram of your own, with Drake alone: nothing of airrace runs the simulation.

    .venv/bin/python examples/own_diagram.py [SECONDS]

airrace gives two diagrams: the Simulation, which holds the truth, and the Autonomy. You join them,
put a system of your own between them (here it shakes the rotors' commands), log what you like, and
run pydrake's Simulator. The map is given, so that nothing is explored or seen, and it is quick. You
learn how to begin an experiment that `airrace race` has no option for.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from pydrake.symbolic import Variable, sin
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, EventStatus
from pydrake.systems.primitives import LogVectorOutput, SymbolicVectorSystem

from airrace.analysis.figure_style import SPEED_COLORS
from airrace.diagrams.autonomy import MakeAutonomy
from airrace.diagrams.simulation import MakeMonitor, MakeSimulation
from airrace.diagrams.wiring import connect_by_name, outputs_of
from airrace.scenario import Scenario
from airrace.scenario.camera_config import CameraConfig
from airrace.vehicle.state import as_plant_state

seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 30.0
scenario = Scenario(track="hexagon", laps=1, map="track", camera=CameraConfig(renderer="none"))
builder = DiagramBuilder()
simulation = builder.AddSystem(MakeSimulation(scenario))
autonomy = builder.AddSystem(MakeAutonomy(scenario))

t, commands = Variable("t"), np.array([Variable(f"w{i}") for i in range(1, 5)])
shaken = [w + 20.0 * sin(60.0 * t + i) for i, w in enumerate(commands)]  # rad/s
shaker = builder.AddSystem(SymbolicVectorSystem(time=t, input=commands, output=shaken))
builder.Connect(autonomy.GetOutputPort("rotor_speed_command"), shaker.get_input_port())
builder.Connect(shaker.get_output_port(), simulation.GetInputPort("rotor_speed_command"))
connect_by_name(builder, [autonomy, simulation], outputs_of(simulation, autonomy))  # all others
log = LogVectorOutput(simulation.GetOutputPort("truth.state"), builder, 0.02)
referee = simulation.GetOutputPort("truth.referee_status")

race = builder.Build()
simulator = Simulator(race)
set_bodies = MakeMonitor(race)  # where gates move, and masses are drawn


def monitor(context):
    set_bodies(context)
    status = referee.Eval(simulation.GetMyContextFromRoot(context))
    return EventStatus.ReachedTermination(race, "over") if status.over else EventStatus.DidNothing()


simulator.set_monitor(monitor)
simulator.AdvanceTo(seconds)

flown = as_plant_state(log.FindLog(simulator.get_context()).data())
x, y, _ = flown.position
speeds = np.linalg.norm(flown.velocity, axis=0)
status = referee.Eval(simulation.GetMyContextFromRoot(simulator.get_context()))
print(f"{simulator.get_context().get_time():.1f} s, {len(status.crossings)} gates passed")
figure, axes = plt.subplots()
figure.colorbar(axes.scatter(x, y, c=speeds, s=4, cmap=SPEED_COLORS), label="speed (m/s)")
axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal", title=scenario.track)
figure.savefig("own_diagram.png", dpi=150)
print(f"Picture: {Path('own_diagram.png').resolve()}")
