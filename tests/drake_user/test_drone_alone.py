"""The drone alone, in the hands of Drake's own tools."""

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.planning import DirectCollocation
from pydrake.solvers import SnoptSolver
from pydrake.systems.analysis import BatchEvalTimeDerivatives, Simulator
from pydrake.systems.controllers import (
    DiscreteTimeLinearQuadraticRegulator,
    FiniteHorizonLinearQuadraticRegulator,
    FiniteHorizonLinearQuadraticRegulatorOptions,
    LinearQuadraticRegulator,
)
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import AffineSystem, Linearize, LogVectorOutput
from pydrake.trajectories import PiecewisePolynomial

from airrace.common.errors import UserError
from airrace.diagrams.drone_alone import MakeDrone, MakeRotorSpeeds, MakeRpyState
from airrace.diagrams.simulation import MakeSimulation
from airrace.math.quaternion import rotation_matrix
from airrace.scenario import Scenario
from airrace.scenario.camera_config import CameraConfig
from airrace.systems.types import ExplorerStatus
from airrace.vehicle import GRAVITY, load_vehicle
from tests.worlds.cases import first
from tests.worlds.hovering_plant import hover

DRONES = first(["StarOne", "Default", "vadr"])
HOVER = np.array([0, 0, 0, 0, 0, 2.0, 0, 0, 0, 0, 0, 0])  # roll, pitch, yaw, x, y, z; rates


def hover_thrusts(vehicle):
    """Thrusts that hold the drone (N), (n,)."""
    _, speeds = hover(vehicle)
    return vehicle.thrust_coefficients * speeds**2


def hovering(drone, thrusts):
    """A context of a drone that hovers."""
    context = drone.CreateDefaultContext()
    context.SetContinuousState(HOVER)
    drone.GetInputPort("thrusts").FixValue(context, thrusts)
    return context


def regulator(name):
    """The feedback of a drone about its hover by thrusts: gains (n, 12), thrusts (n,)."""
    vehicle, sdf = load_vehicle(name)
    drone, thrusts = MakeDrone(vehicle, sdf), hover_thrusts(vehicle)
    linear = Linearize(drone, hovering(drone, thrusts))
    Q, R = np.diag([10.0] * 6 + [1.0] * 6), 0.1 * np.eye(len(thrusts))
    return LinearQuadraticRegulator(linear.A(), linear.B(), Q, R)[0], thrusts


@pytest.mark.parametrize("name", DRONES)
@pytest.mark.parametrize(
    "options, states",
    [
        ({}, 12),
        ({"joint": "quaternion"}, 13),
        ({"command": "rotor_speeds"}, 12),
        ({"command": "rotor_speeds", "lag": True}, None),
        ({"command": "rotor_speeds", "lag": True, "time_step": 0.001}, 0),
    ],
)
def test_converts_and_hovers(name, options, states):
    """To AutoDiffXd and Expression; where it hovers, nothing moves."""
    vehicle, sdf = load_vehicle(name)
    drone = MakeDrone(vehicle, sdf, **options)
    assert drone.ToAutoDiffXd() is not None and drone.ToSymbolic() is not None
    simulator = Simulator(drone)
    context, command = simulator.get_mutable_context(), drone.get_input_port()
    _, speeds = hover(vehicle)
    value = hover_thrusts(vehicle) if command.get_name() == "thrusts" else speeds
    command.FixValue(context, value)
    assert states in (None, context.num_continuous_states())
    if options.get("lag"):
        rotors = drone.GetSubsystemByName("rotor_speeds").GetMyMutableContextFromRoot(context)
        state = rotors.get_mutable_state()
        if options.get("time_step"):
            state.get_mutable_discrete_state().set_value(0, speeds)
        else:
            state.get_mutable_continuous_state().SetFromVector(speeds)
    before = drone.GetOutputPort("state").Eval(context).copy()
    simulator.AdvanceTo(0.5)
    after = drone.GetOutputPort("state").Eval(context)
    np.testing.assert_allclose(after, before, atol=1e-6)


def test_a_lag_belongs_to_speeds():
    with pytest.raises(ValueError, match="command='rotor_speeds'"):
        MakeDrone(*load_vehicle("Default"), lag=True)


@pytest.mark.parametrize(
    "options, words",
    [
        ({"command": "speeds"}, "command must be one of thrusts, rotor_speeds, not 'speeds'"),
        ({"joint": "euler"}, "joint must be one of rpy, quaternion, not 'euler'"),
        ({"time_step": -0.1}, "time_step must be 0 or a positive number"),
        ({"time_step": np.nan}, "time_step must be 0 or a positive number"),
    ],
)
def test_bad_arguments(options, words):
    with pytest.raises(ValueError, match=words):
        MakeDrone(*load_vehicle("Default"), **options)


def test_a_discrete_drone_has_a_regulator():
    vehicle, sdf = load_vehicle("StarOne")
    drone, thrusts = MakeDrone(vehicle, sdf, time_step=0.005), hover_thrusts(vehicle)
    context = drone.CreateDefaultContext()
    drone.get_input_port().FixValue(context, thrusts)
    linear = Linearize(drone, context)
    n, m = linear.B().shape
    gains = DiscreteTimeLinearQuadraticRegulator(linear.A(), linear.B(), np.eye(n), np.eye(m))[0]
    assert np.abs(np.linalg.eigvals(linear.A() - linear.B() @ gains)).max() < 1.0


def test_a_model_that_does_not_fit():
    vehicle, _ = load_vehicle("Default")
    with pytest.raises(UserError, match="mass"):
        MakeDrone(vehicle, load_vehicle("StarOne")[1])


@pytest.mark.parametrize("name", DRONES)
def test_linear_quadratic_regulators_are_stable(name):
    """By the infinite and by the finite horizon, whose first gains are the same."""
    vehicle, sdf = load_vehicle(name)
    drone, thrusts = MakeDrone(vehicle, sdf), hover_thrusts(vehicle)
    context = hovering(drone, thrusts)
    linear = Linearize(drone, context)
    K, _ = regulator(name)
    assert np.linalg.eigvals(linear.A() - linear.B() @ K).real.max() < -0.1
    options = FiniteHorizonLinearQuadraticRegulatorOptions()
    options.x0 = PiecewisePolynomial(HOVER)
    options.u0 = PiecewisePolynomial(thrusts)
    Q, R = np.diag([10.0] * 6 + [1.0] * 6), 0.1 * np.eye(len(thrusts))
    finite = FiniteHorizonLinearQuadraticRegulator(drone, context, 0.0, 15.0, Q, R, options)
    np.testing.assert_allclose(finite.K.value(0.0), K, atol=1e-2 * np.abs(K).max())


@pytest.mark.parametrize("name", DRONES)
def test_a_regulator_flies_in_the_simulation(name):
    """From 0.8 m off to 5 cm within 2 s, with rotors that lag and the simulator's plant."""
    vehicle, _ = load_vehicle(name)
    K, thrusts = regulator(name)
    goal = HOVER.copy()
    builder = DiagramBuilder()
    camera = CameraConfig(renderer="none")
    simulation = builder.AddSystem(
        MakeSimulation(Scenario(drone=name, track="hexagon", map="track", camera=camera))
    )
    feedback = builder.AddSystem(AffineSystem(D=-K, y0=thrusts + K @ goal))
    rpy, speeds = builder.AddSystem(MakeRpyState()), builder.AddSystem(MakeRotorSpeeds(vehicle))
    builder.Connect(simulation.GetOutputPort("truth.state"), rpy.get_input_port())
    builder.Connect(rpy.get_output_port(), feedback.get_input_port())
    builder.Connect(feedback.get_output_port(), speeds.get_input_port())
    builder.Connect(speeds.get_output_port(), simulation.GetInputPort("rotor_speed_command"))
    log = LogVectorOutput(simulation.GetOutputPort("truth.state"), builder, 0.01)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    status = simulation.GetInputPort("explorer_status")
    status.FixValue(
        simulation.GetMyMutableContextFromRoot(context), Value[object](ExplorerStatus())
    )
    plant, rotors = map(simulation.GetSubsystemByName, ("plant", "rotor_bank"))
    state = [1, 0, 0, 0, 0.8, 0, 2, *np.zeros(6)]
    plant.SetPositionsAndVelocities(plant.GetMyMutableContextFromRoot(context), state)
    rotors.set_speeds(rotors.GetMyMutableContextFromRoot(context), hover(vehicle)[1])
    simulator.AdvanceTo(4.0)
    found = log.FindLog(context)
    off = np.linalg.norm(found.data()[4:7].T - goal[3:6], axis=1)
    assert off[0] == pytest.approx(0.8)
    assert off[found.sample_times() >= 2.0].max() < 0.05


def test_direct_collocation_moves_it_aside():
    """Half a metre in a second and a half, from rest to rest, as SNOPT finds it."""
    vehicle, sdf = load_vehicle("Default")
    drone, thrusts = MakeDrone(vehicle, sdf), hover_thrusts(vehicle)
    program = DirectCollocation(drone, hovering(drone, thrusts), 11, 0.1, 0.2)
    program.AddEqualTimeIntervalsConstraints()
    prog, end = program.prog(), HOVER.copy()
    end[3] = 0.5
    prog.AddBoundingBoxConstraint(HOVER, HOVER, program.initial_state())
    prog.AddBoundingBoxConstraint(end, end, program.final_state())
    u = program.input()
    with np.errstate(invalid="ignore"):  # numpy is given symbols
        program.AddRunningCost((u - thrusts).dot(u - thrusts))
    start = PiecewisePolynomial.FirstOrderHold([0.0, 1.5], np.column_stack([HOVER, end]))
    held = PiecewisePolynomial.ZeroOrderHold([0.0, 1.5], np.column_stack([thrusts, thrusts]))
    program.SetInitialTrajectory(held, start)
    result = SnoptSolver().Solve(prog)
    assert result.is_success()
    states = program.ReconstructStateTrajectory(result)
    np.testing.assert_allclose(states.value(states.end_time())[:, 0], end, atol=1e-6)


def test_derivatives_of_many_states():
    """A drop of thrust to zero is a fall, for all."""
    vehicle, sdf = load_vehicle("Default")
    drone = MakeDrone(vehicle, sdf)
    context = hovering(drone, np.zeros(4))
    states = np.random.default_rng(0).uniform(-0.5, 0.5, (12, 100))
    rates = BatchEvalTimeDerivatives(drone, context, np.zeros((1, 100)), states, np.zeros((4, 100)))
    np.testing.assert_allclose(
        rates[9:12], np.array([0.0, 0.0, -GRAVITY])[:, None] + 0 * states[:3], atol=1e-6
    )


@pytest.mark.parametrize(
    ("time_step", "norm", "momentum"), [(1e-3, 1.11, 0.035), (5e-4, 1.05, 0.017)]
)
def test_the_error_of_free_tumbling_is_as_the_page_says(time_step, norm, momentum):
    """At 20 rad/s about no principal axis, after 2 s."""
    vehicle, sdf = load_vehicle("Default")
    drone = MakeDrone(vehicle, sdf, joint="quaternion", time_step=time_step)
    simulator = Simulator(drone)
    context = simulator.get_mutable_context()
    drone.GetInputPort("thrusts").FixValue(context, np.zeros(len(vehicle.rotors)))
    axis = np.array([0.6, 0.5, 0.62])
    w = 20.0 * axis / np.linalg.norm(axis)
    context.SetDiscreteState(np.array([1.0, 0, 0, 0, 0, 0, 500.0, *w, 0, 0, 0]))

    def seen():
        x = context.get_discrete_state_vector().CopyToVector()
        R = rotation_matrix(x[:4])
        inertia = np.diag(vehicle.inertia)
        return np.linalg.norm(x[:4]), np.linalg.norm(R @ inertia @ R.T @ x[7:10])

    _, before = seen()
    simulator.AdvanceTo(2.0)
    length, after = seen()
    assert length == pytest.approx(norm, abs=0.01)
    assert abs(after / before - 1.0) == pytest.approx(momentum, abs=0.003)
