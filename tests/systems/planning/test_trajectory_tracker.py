import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.common.value import Value

from airrace.systems.planning.lap_plan import NO_PLAN, LapPlan, PlanSummary
from airrace.systems.planning.trajectory_tracker import TrajectoryTracker
from airrace.systems.types import ExplorerStatus
from airrace.trajopt.flat_trajectory import flat_outputs, hold
from airrace.trajopt.flight_limits import FlightConstraints, FlightLimits
from airrace.trajopt.min_snap.circuit import plan_circuit
from airrace.trajopt.min_snap.transition import plan_transition_from_hover
from airrace.trajopt.reference import REFERENCE_SIZE, as_reference
from airrace.vehicle import load_vehicle

LIMITS = FlightLimits(load_vehicle("Default")[0], max_speed=20.0, max_acceleration=10.0)
CONSTRAINTS = FlightConstraints([], 2.0, LIMITS)
MIDPOINTS = np.array([[0, -20, 6], [20, 0, 6], [0, 20, 6], [-20, 0, 6]], float)
few = settings(max_examples=40)


def make_plan():
    circuit = plan_circuit(MIDPOINTS, np.arange(4) * np.pi / 2, 4, CONSTRAINTS)
    start = np.zeros((5, 4))
    start[0] = -20, -20, 5, 0
    entry, phase = plan_transition_from_hover(start, circuit, 4, CONSTRAINTS)
    return LapPlan(
        lap=1, start_time=3.0, entry=entry, circuit=circuit, phase=phase, summary=PlanSummary()
    )


PLAN = make_plan()


def reference(plan, exploration, time):
    tracker = TrajectoryTracker()
    context = tracker.CreateDefaultContext()
    tracker.GetInputPort("lap_plan").FixValue(context, Value[object](plan))
    tracker.GetInputPort("exploration_reference").FixValue(context, exploration)
    context.SetTime(time)
    return tracker.GetOutputPort("reference").Eval(context)


@few
@given(
    st.lists(st.floats(-100, 100), min_size=REFERENCE_SIZE, max_size=REFERENCE_SIZE),
    st.floats(0, 1000),
)
def test_before_there_is_a_plan_it_passes_the_explorers_reference_on(exploration, time):
    np.testing.assert_array_equal(reference(NO_PLAN, exploration, time), exploration)


@few
@given(st.floats(3.0, 100.0))
def test_then_it_follows_the_plan(time):
    ours = reference(PLAN, hold([7, 7, 7], 7), time)
    np.testing.assert_array_equal(ours, flat_outputs(PLAN.derivatives(time)))


def test_the_plans_gates_are_on_the_way():
    start = PLAN.next_start(3.0 + PLAN.entry.duration)
    for k, passing in enumerate(PLAN.circuit.gate_times[:-1]):
        ours = reference(PLAN, hold([7, 7, 7], 7), start + passing)
        np.testing.assert_allclose(as_reference(ours).position, MIDPOINTS[k], atol=1e-6)
        assert np.cos(as_reference(ours).yaw - k * np.pi / 2) > 1 - 1e-9
        assert np.linalg.norm(as_reference(ours).velocity) > 1.0


def test_it_forgets_nothing_since_it_remembers_nothing():
    """One system, plan and time changing under it."""
    tracker = TrajectoryTracker()
    context = tracker.CreateDefaultContext()
    tracker.GetInputPort("exploration_reference").FixValue(context, hold([1, 2, 3], 4))
    for plan, time in ((NO_PLAN, 0.0), (PLAN, 5.0), (PLAN, 6.0), (NO_PLAN, 6.0), (PLAN, 4.0)):
        tracker.GetInputPort("lap_plan").FixValue(context, Value[object](plan))
        context.SetTime(time)
        ours = tracker.GetOutputPort("reference").Eval(context)
        np.testing.assert_array_equal(ours, reference(plan, hold([1, 2, 3], 4), time))
    assert tracker.GetOutputPort("reference").size() == REFERENCE_SIZE


def test_a_drone_that_does_not_know_where_it_is_follows_the_explorer_down():
    tracker = TrajectoryTracker()
    context = tracker.CreateDefaultContext()
    down = hold([1, 2, 3], 4)
    tracker.GetInputPort("exploration_reference").FixValue(context, down)
    tracker.GetInputPort("lap_plan").FixValue(context, Value[object](PLAN))
    context.SetTime(5.0)
    for state in ("DONE", "LAND", "DONE"):
        status = Value[object](ExplorerStatus(state=state))
        tracker.GetInputPort("explorer_status").FixValue(context, status)
        ours = tracker.GetOutputPort("reference").Eval(context)
        assert np.array_equal(ours, down) == (state == "LAND")
