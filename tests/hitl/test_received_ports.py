"""What was handed over stands on ports, until there is more."""

import numpy as np
from pydrake.systems.framework import DiagramBuilder

from airrace.diagrams.wiring import initial_values
from airrace.hitl.handover import PortValues
from airrace.hitl.pilot import make_halves
from airrace.hitl.received_ports import ReceivedPorts
from airrace.scenario import Scenario
from airrace.systems.planning.lap_plan import NO_PLAN
from tests.hitl.link.messages import lap_plan


def test_values_stay_until_there_are_others():
    halves = make_halves(Scenario())
    models = initial_values(halves.navigator, halves.pilot, ["lap_plan", "exploration_reference"])
    builder = DiagramBuilder()
    ports = builder.AddSystem(ReceivedPorts(models))
    root = builder.Build().CreateDefaultContext()

    def shown(name):
        return ports.GetOutputPort(name).Eval(ports.GetMyContextFromRoot(root))

    assert shown("lap_plan") is NO_PLAN and shown("exploration_reference").shape == (18,)
    plan = lap_plan()
    ports.show(root, PortValues(2.0, {"lap_plan": plan}))
    ports.show(root, PortValues(3.0, {"exploration_reference": np.arange(18.0)}))
    assert shown("lap_plan") is plan and shown("exploration_reference")[17] == 17.0
    assert shown("values_time")[0] == 3.0


def test_what_the_pilots_side_makes_of_a_sensor_has_its_size():
    halves = make_halves(Scenario())
    models = initial_values(halves.pilot, halves.navigator, ["state_estimate", "filtered_estimate"])
    assert {name: len(model) for name, model in models.items()} == dict.fromkeys(models, 14)
