import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource, ConstantVectorSource

from airrace.diagrams.scenario import Scenario
from airrace.diagrams.simulation import MakeSimulation
from airrace.errors import UserError
from airrace.systems import state_estimate as se
from airrace.systems.geometric_controller import GeometricController
from airrace.systems.types import ExplorerStatus
from airrace.trajopt.flat_trajectory import hold
from airrace.vehicle import GRAVITY, load_vehicle

VEHICLE, _ = load_vehicle("Default")
HOVER_SPEED = np.sqrt(GRAVITY / 4 / 1e-3)


class Flight:
    """A simulation with constant rotor speeds, or a controller at a reference."""

    def __init__(self, speeds=None, reference=None, start=None, racing=False, scenario=None):
        builder = DiagramBuilder()
        self.simulation = builder.AddSystem(MakeSimulation(scenario or Scenario()))
        status = builder.AddSystem(
            ConstantValueSource(Value[object](ExplorerStatus(done=racing)))
        )
        builder.Connect(
            status.get_output_port(), self.simulation.GetInputPort("explorer_status")
        )
        if speeds is not None:
            command = builder.AddSystem(ConstantVectorSource(speeds)).get_output_port()
        else:
            controller = builder.AddSystem(GeometricController(vehicle=VEHICLE, rate=500.0))
            target = builder.AddSystem(ConstantVectorSource(reference))
            builder.Connect(target.get_output_port(), controller.GetInputPort("reference"))
            builder.Connect(
                self.simulation.GetOutputPort("state_estimate"),
                controller.GetInputPort("filtered_estimate"),
            )
            command = controller.get_output_port()
        builder.Connect(command, self.simulation.GetInputPort("rotor_speed_command"))
        self.simulator = Simulator(builder.Build())
        self.context = self.simulation.GetMyContextFromRoot(self.simulator.get_mutable_context())
        plant = self.simulation.GetSubsystemByName("plant")
        if start is not None:
            plant_context = plant.GetMyMutableContextFromRoot(
                self.simulator.get_mutable_context()
            )
            plant.SetPositionsAndVelocities(plant_context, start)
        self.simulator.Initialize()

    def advance(self, time):
        self.simulator.AdvanceTo(time)
        return self

    def __getattr__(self, name):
        ports = {"state": "truth.state", "report": "truth.referee_report",
                 "rotor_speeds": "truth.rotor_speeds"}
        return self.simulation.GetOutputPort(ports.get(name, name)).Eval(self.context)


def start_at(p, v=(0, 0, 0), w=(0, 0, 0)):
    return np.array([1, 0, 0, 0, *p, *w, *v], float)


def test_stands_on_its_pad():
    flight = Flight(speeds=np.zeros(4)).advance(2.0)
    np.testing.assert_allclose(flight.state[4:7], [0, 0, 0.1], atol=5e-3)
    assert not flight.report.over


def test_free_fall():
    flight = Flight(speeds=np.zeros(4), start=start_at([0, 0, 50])).advance(1.0)
    # Semi-implicit Euler at 1 kHz falls half a step too far.
    assert flight.state[6] == pytest.approx(50 - GRAVITY / 2, abs=0.01)
    assert flight.state[12] == pytest.approx(-GRAVITY, abs=1e-6)


def test_free_rotation_conserves_momentum_and_energy():
    w = np.array([3.0, 4.0, 5.0])
    flight = Flight(speeds=np.zeros(4), start=start_at([0, 0, 50], w=w)).advance(1.0)
    J = np.array(VEHICLE.inertia)
    q = flight.state[:4] / np.linalg.norm(flight.state[:4])
    R = quaternion_matrix(q)
    spin = flight.state[7:10]
    # The plant integrates to first order: 0.6 % a second at this spin.
    momentum = R @ (J * (R.T @ spin))
    np.testing.assert_allclose(momentum, J * w, atol=5e-3 * np.linalg.norm(J * w))
    assert (J * (R.T @ spin)) @ (R.T @ spin) == pytest.approx(J @ w**2, rel=1e-2)


def quaternion_matrix(q):
    w, x, y, z = q
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


@pytest.mark.parametrize("faster, axis, sign", [
    ((2, 3), 0, 1),  # the left rotors: roll to the right
    ((0, 3), 1, 1),  # the rear ones: pitch down
    ((1, 3), 2, 1),  # those that turn clockwise: yaw to the left
])
def test_rotors_turn_the_drone_the_right_way(faster, axis, sign):
    speeds = np.full(4, HOVER_SPEED)
    speeds[list(faster)] *= 1.05
    flight = Flight(speeds=speeds, start=start_at([0, 0, 50])).advance(0.1)
    w = flight.state[7:10]
    assert np.argmax(np.abs(w)) == axis
    assert sign * w[axis] > 0


def test_hovers_with_the_controller_and_reports_its_estimate():
    flight = Flight(reference=hold([0, 0, 5], 0.5)).advance(5.0)
    np.testing.assert_allclose(flight.state[4:7], [0, 0, 5], atol=0.05)
    np.testing.assert_allclose(flight.state_estimate[se.POSITION], [0, 0, 5], atol=0.06)
    assert flight.state_estimate[se.TIME] == pytest.approx(5.0, abs=0.0051)
    assert flight.rotor_speeds == pytest.approx([HOVER_SPEED] * 4, rel=0.1)


def test_noise_off():
    flight = Flight(speeds=np.zeros(4), scenario=Scenario(state_noise="none"))
    np.testing.assert_array_equal(flight.state_estimate[1:], flight.state)


@pytest.mark.parametrize("p, v, reason", [
    ([14.0, 5.0, 6.25], [15, 0, 0], "touched board_0"),
    ([14.0, -5.0, 2.0], [15, 0, 0], "touched pylon_1_right"),
    ([0.0, 0.0, 3.0], [0, 0, -8], "hit the ground"),
])
def test_crashes_end_the_race(p, v, reason):
    flight = Flight(speeds=np.full(4, HOVER_SPEED), start=start_at(p, v)).advance(1.0)
    assert flight.report.dnf_reason == reason
    assert flight.report.collisions == 1


def test_flying_through_gate_1_counts():
    speeds = np.full(4, HOVER_SPEED)
    start = start_at([17.0, 0.5, 6.25], [10, 0, 0])
    flight = Flight(speeds=speeds, start=start, racing=True).advance(0.5)
    (crossing,) = flight.report.crossings
    assert crossing.gate == 1
    assert crossing.time == pytest.approx(0.3, abs=0.01)
    assert crossing.offset == pytest.approx(0.5, abs=0.05)


def test_the_start_pose_is_the_tracks(tmp_path):
    flight = Flight(speeds=np.zeros(4))
    np.testing.assert_allclose(flight.state[:4], [1, 0, 0, 0])
    with pytest.raises(UserError, match="track"):
        MakeSimulation(Scenario(track=str(tmp_path / "none.yaml")))
