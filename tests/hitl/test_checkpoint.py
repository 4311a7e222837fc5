"""An autonomy's knowledge on disk: what was saved is what comes back."""

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from airrace.common.errors import UserError
from airrace.diagrams.autonomy import MakeAutonomy
from airrace.hitl.checkpoint import CHECKPOINT, race_of, restore, save, states_of
from airrace.hitl.pilot import make_halves
from airrace.scenario import Scenario
from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.systems.planning.lap_planner import _Memory
from tests.hitl.link.messages import lap_plan

RACE = "0123456789abcdef0123456789abcdef"


def autonomy(drone="Default"):
    builder = DiagramBuilder()
    result = builder.AddSystem(MakeAutonomy(Scenario(drone=drone)))
    diagram = builder.Build()
    return result, diagram.CreateDefaultContext()


def test_what_was_saved_comes_back(tmp_path):
    first, context = autonomy()
    planner = first.GetSubsystemByName("lap_planner")
    plan = lap_plan()
    planner.GetMyMutableContextFromRoot(context).SetAbstractState(0, _Memory(plan=plan))
    monitor = first.GetSubsystemByName("rotor_monitor").GetMyMutableContextFromRoot(context)
    monitor.SetDiscreteState(0, np.arange(monitor.get_discrete_state(0).size()) + 0.1)
    save(tmp_path, RACE, states_of(first, context))
    assert race_of(tmp_path) == RACE
    second, other = autonomy()
    restore(tmp_path, second, other)
    memory = (
        second.GetSubsystemByName("lap_planner")
        .GetMyContextFromRoot(other)
        .get_abstract_state(0)
        .get_value()
    )
    assert memory.plan.lap == 2 and memory.plan.circuit.headings == plan.circuit.headings
    np.testing.assert_array_equal(memory.plan.derivatives(3.0), plan.derivatives(3.0))
    again = second.GetSubsystemByName("rotor_monitor").GetMyContextFromRoot(other)
    np.testing.assert_array_equal(
        again.get_discrete_state(0).value(), monitor.get_discrete_state(0).value()
    )


def test_each_half_goes_on_with_what_both_knew(tmp_path):
    states = {}
    for half in make_halves(Scenario()):
        builder = DiagramBuilder()
        builder.AddSystem(half)
        context = builder.Build().CreateDefaultContext()
        states |= states_of(half, context)
    save(tmp_path, RACE, states)
    whole, context = autonomy()
    restore(tmp_path, whole, context)
    assert states.keys() == {system.get_name() for system in whole.GetSystems()}


def test_no_plan_is_the_same_object_again(tmp_path):
    first, context = autonomy()
    save(tmp_path, RACE, states_of(first, context))
    restore(tmp_path, first, context)
    box = first.GetSubsystemByName("lap_planner")
    port = box.GetOutputPort("lap_plan")
    assert port.Eval(box.GetMyContextFromRoot(context)) is NO_PLAN


def test_bad_checkpoints_are_one_sentence(tmp_path):
    box, context = autonomy()
    with pytest.raises(UserError, match="--resume .* has no checkpoint"):
        restore(tmp_path, box, context)
    (tmp_path / CHECKPOINT).write_bytes(b"torn")
    with pytest.raises(UserError, match="does not fit this scenario"):
        restore(tmp_path, box, context)
    save(tmp_path, RACE, states_of(*autonomy("StarOne")))
    with pytest.raises(UserError, match="does not fit this scenario"):
        restore(tmp_path, box, context)
