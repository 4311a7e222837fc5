"""When the network takes over, what it is shown, and when it hands back."""

import numpy as np
import pytest
from pydrake.common.value import Value

from airrace.systems.policy.command_switch import CommandSwitch
from airrace.systems.policy.gates_observation import write_gates_observation
from airrace.systems.policy.policy_controller import FLYING, PERIOD, PolicyController, _stop
from airrace.systems.types import LAND, ExplorerStatus
from airrace.track import GateEstimate, GateMap, load_track
from airrace.trajopt.flat_trajectory import hold
from airrace.trajopt.reference import as_reference
from airrace.vehicle import GRAVITY, load_vehicle
from airrace.vehicle.state import as_state
from tests.worlds.linear_policy import linear_network

VEHICLE = load_vehicle("Default")[0]
TRACK = load_track("hexagon")
NUMBERS = tuple(range(len(TRACK.gates)))
DONE = ExplorerStatus(state="DONE", gates=NUMBERS, done=True)
HOVER = [VEHICLE.mass * GRAVITY, 0.0, 0.0, 0.0]


def gate_map(numbers=NUMBERS):
    return GateMap(
        gates=tuple(
            GateEstimate(n, g.p_WG, g.heading, g.pylon_spacing)
            for n, g in enumerate(TRACK.gates)
            if n in numbers
        )
    )


def estimate(position, velocity=(0, 0, 0), q=(1, 0, 0, 0)):
    return np.array([0.0, *q, *position, 0, 0, 0, *velocity], float)


class Bench:
    """The controller alone, its inputs fixed: it hovers over the start, and the map is complete."""

    def __init__(self, network=None, explorer=DONE, known=None):
        self.controller = PolicyController(
            vehicle=VEHICLE, network=network or linear_network(VEHICLE)
        )
        self.context = self.controller.CreateDefaultContext()
        self.start = np.array([*TRACK.start.position[:2], 5.0])
        self.fix("filtered_estimate", estimate(self.start))
        self.fix("gate_map", Value[object](known or gate_map()))
        self.fix("explorer_status", Value[object](explorer))
        self.fix("exploration_reference", hold(self.start, 0.3))
        self.fix("rotor_losses", np.full(4, np.inf))

    def fix(self, port, value):
        self.controller.GetInputPort(port).FixValue(self.context, value)

    def step(self, times=1):
        for _ in range(times):
            after = self.controller.EvalUniquePeriodicDiscreteUpdate(self.context).value().copy()
            self.context.SetDiscreteState(after)
            self.context.SetTime(self.context.get_time() + PERIOD)
        return self.status

    def eval(self, port):
        return self.controller.GetOutputPort(port).Eval(self.context)

    @property
    def status(self):
        return self.eval("policy_status")

    @property
    def memory(self):
        return self.controller._recall(self.context)


def test_it_waits_for_the_end_of_the_exploration():
    bench = Bench(explorer=ExplorerStatus(state="RETURN", gates=NUMBERS))
    status = bench.step(400)
    assert not status.flies and not status.planner_may_plan and not status.reason
    assert bench.eval("policy_flies") == 0.0
    np.testing.assert_allclose(bench.eval("rate_command"), HOVER)
    np.testing.assert_array_equal(bench.eval("safe_reference"), hold(bench.start, 0.3))
    bench.fix("explorer_status", Value[object](DONE))
    assert bench.step().flies and bench.eval("policy_flies") == 1.0


def test_it_sees_what_the_environment_shows():
    seen = []

    class Watched(type(linear_network(VEHICLE))):
        def act(self, observation):
            seen.append(observation.copy())
            return super().act(observation)

    bench = Bench(network=Watched(*linear_network(VEHICLE)))
    bench.step()
    first = bench.memory.action.copy()
    state = estimate(bench.start + [1.0, 0.2, 0.1], (2.0, 0.1, 0.3), q=(0.9, 0.1, -0.2, 0.3))
    bench.fix("filtered_estimate", state)
    bench.step()
    expected = np.empty(43)
    write_gates_observation(expected, as_state(state), TRACK.openings(), 0, first)
    np.testing.assert_allclose(seen[-1], expected, atol=1e-12)


def test_gates_count_in_the_order_in_which_they_were_found():
    order = (*NUMBERS[2:], *NUMBERS[:2])
    bench = Bench(explorer=ExplorerStatus(state="DONE", gates=order, done=True))
    bench.step()
    gate = TRACK.gates[2]
    for distance in (-1.0, -0.1, 0.2):
        bench.fix("filtered_estimate", estimate(gate.p_WG + distance * gate.forward))
        status = bench.step()
    assert status.passed == 1 and status.flies


def test_a_missed_gate_hands_back():
    bench = Bench()
    bench.step()
    gate = TRACK.gates[0]
    for distance in (-0.1, 0.2):
        p = gate.p_WG + distance * gate.forward + 6.0 * gate.rightward
        bench.fix("filtered_estimate", estimate(p, 8.0 * gate.forward))
        status = bench.step()
    assert not status.flies and status.reason == "it missed a gate" and status.passed == 0


def bounded(**bounds):
    """Returns a network that knows speeds forward of up to 3 m/s."""
    high = np.full(43, np.inf)
    high[0] = 3.0
    return linear_network(VEHICLE, high=high, **bounds)


def test_what_it_does_not_know_for_a_moment_is_flown_through():
    bench = Bench(network=bounded())
    bench.step()
    bench.fix("filtered_estimate", estimate(bench.start, (3.5, 0, 0)))
    assert bench.step(4).flies
    bench.fix("filtered_estimate", estimate(bench.start, (2.5, 0, 0)))
    assert bench.step().flies
    bench.fix("filtered_estimate", estimate(bench.start, (3.5, 0, 0)))
    assert bench.step(4).flies and not bench.step().flies
    assert bench.status.reason == "it saw what it was not trained on"


def test_after_the_hand_back_it_brakes_and_then_the_planner_may_plan():
    bench = Bench(network=bounded())
    bench.step()
    bench.fix("filtered_estimate", estimate(bench.start, (6.0, 0, 0)))
    bench.step(5)
    assert not bench.status.planner_may_plan
    begin = as_reference(bench.eval("safe_reference"))
    np.testing.assert_allclose(begin.velocity, [6.0, 0, 0], atol=0.2)
    times = np.arange(0.0, 3.0, 0.01)
    references = as_reference(np.transpose([_stop(bench.memory).reference(t) for t in times]))
    # Its velocity is the derivative of its position, and it stops.
    slopes = np.gradient(references.position[0], times)
    np.testing.assert_allclose(slopes[2:-2], references.velocity[0, 2:-2], atol=0.07)
    np.testing.assert_allclose(references.velocity[:, -1], 0.0)
    assert references.position[0, -1] == pytest.approx(bench.start[0] + 3.0, abs=1e-6)
    assert bench.step(120).planner_may_plan
    # For good.
    bench.fix("filtered_estimate", estimate(bench.start))
    assert not bench.step(50).flies


def test_near_the_ground_it_brakes_level():
    bench = Bench(network=bounded())
    bench.step()
    bench.fix("filtered_estimate", estimate([-20, -25, 3.0], (6.0, 0.0, -4.0)))
    bench.step(5)
    assert bench.memory.velocity[2] == 0.0


@pytest.mark.parametrize(
    "port, value, reason",
    [
        ("rotor_losses", np.array([np.inf, 3.0, np.inf, np.inf]), "a rotor is lost"),
        ("gate_map", Value[object](gate_map(NUMBERS[1:])), "a gate is not on the map any more"),
        (
            "explorer_status",
            Value[object](ExplorerStatus(state=LAND, gates=NUMBERS, done=True)),
            "the drone has to land",
        ),
    ],
)
def test_it_hands_back_at_once(port, value, reason):
    bench = Bench()
    assert bench.step(3).flies
    bench.fix(port, value)
    status = bench.step()
    assert not status.flies and status.reason == reason
    if "land" in reason:  # the explorer knows how
        np.testing.assert_array_equal(bench.eval("safe_reference"), hold(bench.start, 0.3))


def test_an_estimate_that_is_not_finite_holds_the_command_and_then_hands_back():
    bench = Bench()
    bench.step(3)
    before = bench.eval("rate_command")
    bench.fix("filtered_estimate", np.full(14, np.nan))
    assert bench.step(4).flies
    np.testing.assert_array_equal(bench.eval("rate_command"), before)
    assert not bench.step().flies
    assert np.isfinite(bench.eval("safe_reference")).all()


@pytest.mark.parametrize("known, speed", [(NUMBERS[1:], 0.0), (NUMBERS, 2.0)])
def test_a_drone_that_is_not_ready_is_the_planners(known, speed):
    bench = Bench(known=gate_map(known))
    bench.fix("filtered_estimate", estimate(bench.start, (speed, 0, 0)))
    assert not bench.step(100).reason
    status = bench.step(60)
    assert status.reason == "the drone was not ready for it" and status.planner_may_plan
    np.testing.assert_array_equal(bench.eval("safe_reference"), hold(bench.start, 0.3))


def test_commands_are_what_the_actions_stand_for():
    network = linear_network(VEHICLE, hovers=True)
    bench = Bench(network=network)
    bench.step()
    assert bench.memory.phase == FLYING
    np.testing.assert_allclose(bench.eval("rate_command"), HOVER, atol=1e-9)


def test_the_switch():
    switch = CommandSwitch(rotors=4)
    context = switch.CreateDefaultContext()
    switch.GetInputPort("planned_command").FixValue(context, np.full(4, 1.0))
    switch.GetInputPort("policy_command").FixValue(context, np.full(4, 2.0))
    for flies, command in ((0.0, 1.0), (1.0, 2.0)):
        switch.GetInputPort("policy_flies").FixValue(context, [flies])
        np.testing.assert_array_equal(switch.get_output_port().Eval(context), np.full(4, command))
