import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RollPitchYaw, RotationMatrix
from pydrake.systems.analysis import Simulator

from airrace.systems.geometric_controller import GeometricController
from airrace.trajopt.flat_trajectory import ACCELERATION, JERK, SNAP, hold
from airrace.trajopt.flatness import attitude_from_force, heading_vectors, rotor_thrusts
from airrace.vehicle import GRAVITY, load_vehicle

VEHICLE, _ = load_vehicle("Default")
CONTROLLER = GeometricController(vehicle=VEHICLE, rate=500.0)


def estimate(p=(0, 0, 5), R=RotationMatrix(), w=(0, 0, 0), v=(0, 0, 0)):
    return np.concatenate([[0.0], R.ToQuaternion().wxyz(), p, w, v]).astype(float)


def test_hovers_at_the_reference():
    wrench = CONTROLLER.CalcWrench(hold([0, 0, 5], 0.0), estimate())
    np.testing.assert_allclose(wrench, [VEHICLE.mass * GRAVITY, 0, 0, 0], atol=1e-12)


@pytest.mark.parametrize("axis", range(3))
def test_pushes_against_errors(axis):
    """Right of the target, roll left; ahead of it, pitch back; above, less thrust."""
    p = np.array([0.0, 0.0, 5.0])
    p[axis] += 0.5
    f, mx, my, _ = CONTROLLER.CalcWrench(hold([0, 0, 5], 0.0), estimate(p))
    if axis == 0:
        assert my < 0
    elif axis == 1:
        assert mx > 0
    else:
        assert f < VEHICLE.mass * GRAVITY


angles = st.floats(-1.0, 1.0)


@given(angles, angles, st.floats(-3, 3))
def test_turns_back_to_level(roll, pitch, yaw):
    """The moment does work against any attitude error."""
    R = RollPitchYaw(roll, pitch, yaw).ToRotationMatrix()
    error = (RollPitchYaw(0, 0, yaw).ToRotationMatrix().inverse() @ R).ToAngleAxis()
    wrench = CONTROLLER.CalcWrench(hold([0, 0, 5], yaw), estimate(R=R))
    torque_along_error = wrench[1:] @ error.axis() * np.sign(error.angle())
    assert torque_along_error <= 1e-9
    if abs(error.angle()) > 1e-3:
        assert torque_along_error < 0


vectors = st.tuples(*[st.floats(-8, 8)] * 3)


@given(vectors, vectors, vectors, st.floats(-3, 3), st.floats(-2, 2), st.floats(-2, 2))
def test_feed_forward_is_inverse_dynamics(a, j, s, yaw, rate, acceleration):
    """On the trajectory, the controller commands what flatness says."""
    reference = hold([0, 0, 5], yaw)
    reference[ACCELERATION], reference[JERK], reference[SNAP] = a, j, s
    reference[16:] = rate, acceleration
    if reference[8] + GRAVITY < 3.0:
        reference[8] = 0.0
    force = (*reference[6:8], reference[8] + GRAVITY)
    axes, w, _ = attitude_from_force(
        force, j, s, heading_vectors(np.cos(yaw), np.sin(yaw), rate, acceleration)
    )
    R = RotationMatrix(np.array(axes).T)
    wrench = CONTROLLER.CalcWrench(reference, estimate(R=R, w=R.matrix() @ w))
    expected = VEHICLE.allocation @ rotor_thrusts(reference[:, None], VEHICLE, GRAVITY)[:, 0]
    np.testing.assert_allclose(wrench, expected, atol=1e-8, rtol=1e-8)


def test_commands_are_held_at_the_control_rate_and_within_limits():
    controller = GeometricController(vehicle=VEHICLE, rate=500.0)
    simulator = Simulator(controller)
    context = simulator.get_mutable_context()
    controller.GetInputPort("reference").FixValue(context, hold([0, 0, 5], 0.0))
    commands = []
    for k, p in enumerate([(0, 0, 5), (100, -100, -50), (0, 0, 200), (0, 0, 5)]):
        controller.GetInputPort("filtered_estimate").FixValue(context, estimate(p))
        simulator.AdvanceTo((k + 0.5) / 500)
        commands.append(controller.get_output_port().Eval(context))
    commands = np.array(commands)
    assert np.all(commands >= 0) and np.all(commands <= VEHICLE.max_speeds)
    np.testing.assert_allclose(commands[0], np.sqrt(GRAVITY / 4 / 1e-3))
