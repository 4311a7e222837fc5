"""The watchdog alone, and a whole drone that is left alone in flight."""

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource, ConstantVectorSource, VectorLogSink

from airrace.diagrams.command_watchdog import AddCommandWatchdog
from airrace.diagrams.simulation import MakeSimulation
from airrace.scenario import Scenario
from airrace.systems.failsafe.command_watchdog import FOLLOW, HOLD, HOVER, LAND, CommandWatchdog
from airrace.systems.types import ExplorerStatus
from airrace.trajopt.reference import NO_LIFT, as_reference
from airrace.vehicle.state import STATE_SIZE, as_state

REMOTE, OWN = np.full(4, 50.0), np.full(4, 40.0)


class Bench:
    """A CommandWatchdog whose inputs a test may change; the drone is at 6 m, flying."""

    def __init__(self, height=6.0, velocity=(9.0, 0.0, 0.0)):
        self.watchdog = CommandWatchdog(rotors=4, rate=500.0)
        self.simulator = Simulator(self.watchdog)
        self.context = self.simulator.get_mutable_context()
        self.place(0.0)  # on the pad first
        self.fix(rotor_speed_command=REMOTE, own_command=OWN, rotor_speed_command_time=[0.0])
        self.simulator.Initialize()
        self.simulator.AdvanceTo(0.01)
        self.place(height, velocity)

    def fix(self, **inputs):
        for name, value in inputs.items():
            self.watchdog.GetInputPort(name).FixValue(self.context, value)

    def place(self, height, velocity=(0.0, 0.0, 0.0)):
        estimate = np.zeros(STATE_SIZE)
        estimate[1], as_state(estimate).position[:] = 1.0, [1.0, 2.0, height]
        as_state(estimate).velocity[:] = velocity
        self.fix(state_estimate=estimate)

    def at(self, time, sent=None):
        """Advances, with a command that was sent at a time; returns mode and command."""
        if sent is not None:
            self.fix(rotor_speed_command_time=[sent])
        self.simulator.AdvanceTo(time)
        command = self.watchdog.GetOutputPort("rotor_speed_command").Eval(self.context)
        return int(self.watchdog.recall(self.context).mode), command.tolist()

    def reference(self):
        return self.watchdog.GetOutputPort("reference").Eval(self.context).copy()


def test_follows_holds_hovers_and_lands():
    bench = Bench()
    sent = 1.0
    for age, mode in (
        (0.05, FOLLOW),
        (0.099, FOLLOW),
        (0.11, HOLD),
        (0.49, HOLD),
        (0.51, HOVER),
        (1.99, HOVER),
        (2.01, LAND),
        (4.0, LAND),
    ):
        found, command = bench.at(sent + age, sent)
        assert found == mode
        assert command == (REMOTE if mode < HOVER else OWN).tolist()
    m = bench.watchdog.recall(bench.context)
    assert (m.holds, m.hovers, m.landings) == (1, 1, 1)
    assert m.oldest == pytest.approx(4.0, abs=0.01)


def test_its_own_controller_rests_while_commands_are_fresh_and_is_ready_when_they_are_not():
    bench = Bench()
    bench.at(1.05, sent=1.0)
    assert np.isnan(bench.reference()).all()
    for height in (6.0, 7.0):  # where the drone is while a command is held
        bench.place(height)
        bench.at(1.1 + height / 20, sent=1.0)
        np.testing.assert_array_equal(as_reference(bench.reference()).position, [1.0, 2.0, height])
    bench.place(8.0)
    bench.at(1.6, sent=1.0)
    bench.place(9.0)
    bench.at(1.7, sent=1.0)
    assert bench.reference()[2] == 8.0  # where it was left alone


@pytest.mark.parametrize("age", [0.3, 1.0, 3.0])
def test_a_fresh_command_arms_it_again(age):
    bench = Bench()
    bench.at(1.0 + age, sent=1.0)
    assert bench.at(1.004 + age, sent=1.0 + age) == (FOLLOW, REMOTE.tolist())


def test_an_older_command_or_one_of_the_future_does_not():
    bench = Bench()
    bench.at(2.0, sent=1.0)
    assert bench.at(2.1, sent=0.5)[0] == HOVER
    # It counts as one of now, and grows old like any other.
    assert bench.at(2.2, sent=99.0)[0] == FOLLOW
    bench.fix(rotor_speed_command_time=[2.0])
    assert bench.at(2.8)[0] == HOVER


def test_near_the_ground_a_landing_is_finished():
    bench = Bench(height=0.8)
    bench.at(4.0, sent=1.0)
    assert bench.at(4.1, sent=4.1)[0] == LAND


def test_on_the_pad_the_rotors_idle():
    bench = Bench(height=0.0)
    assert bench.at(4.0, sent=1.0)[0] == LAND
    assert as_reference(bench.reference()).acceleration[2] < NO_LIFT


def test_it_brakes_evenly_stays_and_sinks_to_the_ground():
    bench = Bench()
    bench.at(1.0, sent=0.4)  # left alone after 0.9 s
    path = []
    for time in np.arange(1.0, 9.0, 0.01):
        bench.at(time, sent=0.4)
        path.append(bench.reference())
    path = np.array(path)
    speed = np.gradient(path[:, :3], 0.01, axis=0)
    np.testing.assert_allclose(speed[5:-5], as_reference(path[5:-5].T).velocity.T, atol=1.01)
    assert np.abs(as_reference(path.T).acceleration).max() == 6.0
    stop = 1.0 + 9.0**2 / 12.0
    np.testing.assert_allclose(path[160:, 0], stop, atol=1e-9)
    assert (path[:140, 2] == 6.0).all() and (np.diff(path[160:, 2]) < 0).all()
    assert path[-1, 2] < 0.1


def fly(silent, until):
    """Flies a drone that is left alone from a time on; returns times and states."""
    scenario = Scenario()
    builder = DiagramBuilder()
    simulation = builder.AddSystem(MakeSimulation(scenario))
    status = builder.AddSystem(ConstantValueSource(Value[object](ExplorerStatus())))
    builder.Connect(status.get_output_port(), simulation.GetInputPort("explorer_status"))
    link = DiagramBuilder()
    for name, value in (
        ("rotor_speed_command", np.full(4, np.sqrt(9.81 / 4 / 1e-3)) * 1.02),
        ("rotor_speed_command_time", [silent]),
    ):
        link.ExportOutput(link.AddSystem(ConstantVectorSource(value)).get_output_port(), name)
    link = builder.AddSystem(link.Build())
    watchdog = AddCommandWatchdog(builder, scenario, simulation, link)
    log = builder.AddSystem(VectorLogSink(13, 0.01))
    builder.Connect(simulation.GetOutputPort("truth.state"), log.get_input_port())
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    plant = simulation.GetSubsystemByName("plant")
    plant_context = plant.GetMyMutableContextFromRoot(context)
    X_WB = RigidTransform(RollPitchYaw(0.4, -0.3, 1.0), [0.0, 0.0, 7.0])
    plant.SetFloatingBaseBodyPoseInWorldFrame(plant_context, plant.GetBodyByName("body"), X_WB)
    plant.SetVelocities(plant_context, np.array([1.0, -2.0, 0.5, 8.0, 3.0, 0.0]))
    m = watchdog.recall(watchdog.GetMyContextFromRoot(context))
    m = m._replace(pad=0.0, airborne=1.0)
    watchdog.GetMyMutableContextFromRoot(context).SetDiscreteState(0, np.hstack(m))
    simulator.Initialize()
    simulator.AdvanceTo(until)
    data = log.FindLog(context)
    report = simulation.GetOutputPort("truth.referee_status").Eval(
        simulation.GetMyContextFromRoot(context)
    )
    return data.sample_times(), data.data().T, watchdog, report


@pytest.mark.slow
def test_a_drone_left_alone_in_a_tumble_levels_hovers_and_lands_gently():
    times, states, _, report = fly(silent=-0.5, until=9.0)
    down = report.end_time
    assert report.dnf_reason == "hit the ground" and 3.0 < down < 8.0
    before = times < down
    w, x, y, z = states[:, :4].T
    tilt = np.degrees(np.arccos(1 - 2 * (x * x + y * y)))
    assert tilt[before & (times > 3.0)].max() < 5.0
    touch = np.flatnonzero(before)[-1]
    assert np.linalg.norm(states[touch, 10:13]) < 0.8  # m/s
    assert states[before, 6].min() > 0.05
