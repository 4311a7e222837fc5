import shutil

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.common.yaml import yaml_dump_typed
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource, ConstantVectorSource
from scipy.spatial.transform import Rotation

from airrace.common.errors import UserError
from airrace.diagrams.simulation import MakeMonitor, MakeSimulation
from airrace.rendering.vtk.vtk_renderer import check_vtk_available
from airrace.scenario import RotorsConfig, Scenario
from airrace.scenario.camera_config import RENDERERS, CameraConfig
from airrace.systems.sensing.imu_samples import as_samples
from airrace.systems.types import ExplorerStatus
from airrace.track import load_track
from airrace.vehicle import GRAVITY, find_vehicle, load_vehicle
from airrace.vehicle.disturbances import DisturbancesConfig, RotorFailure, WindConfig, true_vehicle
from airrace.vehicle.sensor_failures import CameraFailure, ImuFailure
from airrace.vehicle.state import as_state

VEHICLE, _ = load_vehicle("Default")
HOVER_SPEED = np.sqrt(GRAVITY / 4 / 1e-3)


class Flight:
    """A simulation with constant rotor speeds."""

    def __init__(self, speeds, start=None, racing=False, scenario=None, meshcat=None):
        builder = DiagramBuilder()
        self.simulation = builder.AddSystem(MakeSimulation(scenario or Scenario(), meshcat))
        status = builder.AddSystem(ConstantValueSource(Value[object](ExplorerStatus(done=racing))))
        builder.Connect(status.get_output_port(), self.simulation.GetInputPort("explorer_status"))
        command = builder.AddSystem(ConstantVectorSource(speeds)).get_output_port()
        builder.Connect(command, self.simulation.GetInputPort("rotor_speed_command"))
        self.simulator = Simulator(builder.Build())
        self.context = self.simulation.GetMyContextFromRoot(self.simulator.get_mutable_context())
        plant = self.simulation.GetSubsystemByName("plant")
        if start is not None:
            plant_context = plant.GetMyMutableContextFromRoot(self.simulator.get_mutable_context())
            plant.SetPositionsAndVelocities(plant_context, start)
        self.simulator.Initialize()

    def advance(self, time):
        self.simulator.AdvanceTo(time)
        return self

    def __getattr__(self, name):
        ports = {"state": "truth.state", "report": "truth.referee_status"}
        return self.simulation.GetOutputPort(ports.get(name, name)).Eval(self.context)


def start_at(p, v=(0, 0, 0), w=(0, 0, 0)):
    return np.array([1, 0, 0, 0, *p, *w, *v], float)


@pytest.mark.parametrize("drone, height", [("Default", 0.1), ("StarOne", 0.25)])
def test_stands_on_its_pad(drone, height):
    rotors = len(load_vehicle(drone)[0].rotors)
    flight = Flight(speeds=np.zeros(rotors), scenario=Scenario(drone=drone))
    np.testing.assert_allclose(flight.state[:7], [1, 0, 0, 0, 0, 0, height], atol=1e-12)
    flight.advance(1.0)
    np.testing.assert_allclose(flight.state[:7], [1, 0, 0, 0, 0, 0, height], atol=1e-3)
    np.testing.assert_allclose(flight.state[7:], 0.0, atol=1e-6)
    plant = flight.simulation.GetSubsystemByName("plant")
    contacts = plant.get_contact_results_output_port().Eval(
        plant.GetMyContextFromRoot(flight.simulator.get_context())
    )
    depths = [
        contacts.point_pair_contact_info(i).point_pair().depth
        for i in range(contacts.num_point_pair_contacts())
    ]
    assert len(depths) == 4 and max(depths) < 1e-3
    assert not flight.report.over


def test_a_drone_on_long_legs_is_not_in_the_air(tmp_path):
    shutil.copytree(find_vehicle("Default").parent, tmp_path / "mine")
    sdf = tmp_path / "mine" / "default.sdf"
    sdf.write_text(
        sdf.read_text().replace(
            "</link>",
            "".join(
                f'<collision name="foot_{x}_{y}"><pose>{x} {y} -0.8 0 0 0</pose>'
                "<geometry><sphere><radius>0.1</radius></sphere></geometry></collision>"
                for x in (-0.15, 0.15)
                for y in (-0.15, 0.15)
            )
            + "</link>",
        )
    )
    flight = Flight(speeds=np.zeros(4), scenario=Scenario(drone=str(tmp_path / "mine")))
    flight.advance(0.5)
    np.testing.assert_allclose(flight.state[4:7], [0, 0, 0.9], atol=2e-3)
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
    R = Rotation.from_quat(flight.state[:4], scalar_first=True).as_matrix()
    spin = flight.state[7:10]
    # The plant integrates to first order: 0.6 % a second at this spin.
    momentum = R @ (J * (R.T @ spin))
    np.testing.assert_allclose(momentum, J * w, atol=5e-3 * np.linalg.norm(J * w))
    assert (J * (R.T @ spin)) @ (R.T @ spin) == pytest.approx(J @ w**2, rel=1e-2)


@pytest.mark.parametrize(
    "faster, axis, sign",
    [
        ((2, 3), 0, 1),  # the left rotors: roll to the right
        ((0, 3), 1, 1),  # the rear ones: pitch down
        ((1, 3), 2, 1),  # those that turn clockwise: yaw to the left
    ],
)
def test_rotors_turn_the_drone_the_right_way(faster, axis, sign):
    speeds = np.full(4, HOVER_SPEED)
    speeds[list(faster)] *= 1.05
    flight = Flight(speeds=speeds, start=start_at([0, 0, 50])).advance(0.1)
    w = flight.state[7:10]
    assert np.argmax(np.abs(w)) == axis
    assert sign * w[axis] > 0


def test_hovers_and_reports_its_estimate():
    start = start_at([0, 0, 5])
    flight = Flight(speeds=np.full(4, HOVER_SPEED), start=start)
    rotors = flight.simulation.GetSubsystemByName("rotor_bank")
    context = rotors.GetMyMutableContextFromRoot(flight.simulator.get_mutable_context())
    rotors.set_speeds(context, np.full(4, HOVER_SPEED))
    flight.advance(5.0)
    np.testing.assert_allclose(flight.state, start, atol=1e-6)
    np.testing.assert_allclose(as_state(flight.state_estimate).position, [0, 0, 5], atol=0.03)
    assert as_state(flight.state_estimate).time == pytest.approx(5.0, abs=0.0051)
    assert flight.rotor_speeds == pytest.approx([HOVER_SPEED] * 4)


def test_noise_off():
    flight = Flight(speeds=np.zeros(4), scenario=Scenario(state_noise="none"))
    np.testing.assert_array_equal(flight.state_estimate[1:], flight.state)


@pytest.mark.parametrize(
    "p, v, reason",
    [
        ([14.0, 5.0, 6.25], [15, 0, 0], "touched board_0"),
        ([14.0, -5.0, 2.0], [15, 0, 0], "touched pylon_1_right"),
        ([0.0, 0.0, 3.0], [0, 0, -8], "hit the ground"),
    ],
)
def test_crashes_end_the_race(p, v, reason):
    flight = Flight(speeds=np.full(4, HOVER_SPEED), start=start_at(p, v)).advance(1.0)
    assert flight.report.dnf_reason == reason
    assert flight.report.collisions == 1


@pytest.mark.parametrize("step", range(5))
def test_a_touch_of_a_single_step_ends_the_race(step):
    """Whenever it happens between two looks of the referee, which are five steps apart."""
    v, depth = 15.0, 0.002
    beside = 5.0 + 1.5 / 2 + 0.25 - depth  # the edge of board 0, and how wide the drone is
    start = start_at([19.0 + 0.001 * v * step, beside, 6.25], [v, 0, 0])
    flight = Flight(speeds=np.full(4, HOVER_SPEED), start=start)
    plant = flight.simulation.GetSubsystemByName("plant")
    contacts = plant.get_contact_results_output_port()
    context = plant.GetMyContextFromRoot(flight.simulator.get_context())
    touched = [
        k
        for k in range(1, 13)
        if flight.advance(0.001 * k) and contacts.Eval(context).num_point_pair_contacts()
    ]
    assert len(touched) == 1
    assert flight.report.dnf_reason == "touched board_0"
    assert flight.report.end_time <= 0.001 * touched[0] + 0.005


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


def test_sensors_fail_when_the_scenario_says_so():
    scenario = Scenario(
        estimator="vio",
        imu_failures=[ImuFailure("nan", 0.05, 0.05)],
        camera_failures=[CameraFailure("dark", 0.05, 0.05)],
    )
    flight = Flight(speeds=np.zeros(4), scenario=scenario)
    for time, fails in ((0.05, False), (0.09, True), (0.15, False)):
        flight.advance(time)  # the pictures are of 0.033, 0.067 and 0.133 s
        assert np.isnan(as_samples(flight.imu).specific_force[0]).all() == fails
        assert flight.camera_view.region(600, 340, 640, 380).any() != fails


class TestDisturbances:
    ALL = DisturbancesConfig(
        wind=WindConfig([4.0, 3.0, 0.5], gust_rms=2.0),
        drag=1.0,
        mass_error=0.1,
        inertia_error=0.1,
        thrust_coefficient_error=0.1,
        actuator_delay=0.01,
    )

    @staticmethod
    def history(seconds=0.2, rate=1000.0, **others):
        """Rotor speeds after every step of the plant, from rest and from a command at once."""
        scenario = Scenario(rotors=RotorsConfig(rate=rate), **others)
        flight = Flight(speeds=np.full(4, 60.0), scenario=scenario)
        times = np.arange(round(seconds / 0.001)) * 0.001 + 0.0005
        return np.array([flight.advance(time).rotor_speeds for time in times])

    @pytest.mark.parametrize(
        "rate, delay, steps",
        [
            (1e3, 0.001, 1),
            (1e3, 0.01, 10),
            (1e3, 0.0304, 30),
            (1e3, 0.0306, 31),
            (1e3, 0.0001, 1),
            (500.0, 0.01, 10),
            (500.0, 0.006, 6),
            (500.0, 0.001, 2),
        ],
    )
    def test_a_delay_is_exact(self, rate, delay, steps):
        prompt = self.history(rate=rate)
        late = self.history(rate=rate, disturbances=DisturbancesConfig(actuator_delay=delay))
        assert np.all(prompt[0] > 0.0)
        np.testing.assert_array_equal(late[:steps], 0.0)
        np.testing.assert_array_equal(late[steps:], prompt[:-steps])

    def test_a_rotor_fails(self):
        healthy = self.history()
        failing = self.history(rotor_failures=[RotorFailure(3, 0.1)])
        np.testing.assert_array_equal(failing[:, [0, 1, 3]], healthy[:, [0, 1, 3]])
        np.testing.assert_array_equal(failing[:100, 2], healthy[:100, 2])
        np.testing.assert_allclose(
            failing[100:, 2], healthy[99, 2] * np.exp(-np.arange(1, 101) * 0.001 / 0.03)
        )

    def test_a_crash_after_a_failure_says_so(self):
        scenario = Scenario(rotor_failures=[RotorFailure(2, 0.1), RotorFailure(4, 9.0)])
        flight = Flight(
            speeds=np.full(4, HOVER_SPEED), start=start_at([0, 0, 3.0]), scenario=scenario
        ).advance(3.0)
        assert flight.report.dnf_reason == "hit the ground after rotor 2 had failed"

    def test_a_rotor_that_is_not_there_cannot_fail(self):
        with pytest.raises(UserError, match="there is no rotor 5; the Default has rotors 1 to 4"):
            MakeSimulation(Scenario(rotor_failures=[RotorFailure(5, 1.0)]))

    def test_the_world_has_the_true_drone(self):
        truth = true_vehicle(VEHICLE, self.ALL, seed=3)
        flight = Flight(speeds=[50.0] * 4, scenario=Scenario(disturbances=self.ALL, seed=3))
        body = flight.simulation.GetSubsystemByName("plant").GetBodyByName("body")
        assert body.default_mass() == pytest.approx(truth.mass, rel=1e-12)
        flight.advance(1.0)
        bank = flight.simulation.GetSubsystemByName("rotor_bank")
        thrusts = bank.GetOutputPort("thrusts").Eval(
            bank.GetMyContextFromRoot(flight.simulator.get_context())
        )
        np.testing.assert_allclose(thrusts, truth.thrust_coefficients * 2500.0)

    def test_the_wind_carries_the_drone_and_needs_drag(self):
        start = start_at([0, 0, 50.0])
        for drag in (0.0, 1.0):
            config = DisturbancesConfig(wind=WindConfig([5.0, 0.0, 0.0]), drag=drag)
            flight = Flight(
                speeds=np.full(4, HOVER_SPEED), start=start, scenario=Scenario(disturbances=config)
            ).advance(1.0)
            # (linear + quadratic |v|) v, on 1 kg, with v falling a little.
            force = drag * (0.1 + 0.006 * 5.0) * 5.0
            assert flight.state[10] == pytest.approx(force, rel=0.1, abs=1e-9)
            names = {system.get_name() for system in flight.simulation.GetSystems()}
            assert ("drag" in names) == ("wind" in names) == (drag > 0.0)

    def test_the_seed_decides(self):
        def fly(seed):
            scenario = Scenario(
                disturbances=self.ALL, rotor_failures=[RotorFailure(2, 1.5)], seed=seed
            )
            flight = Flight(
                speeds=np.full(4, HOVER_SPEED), start=start_at([0, 0, 50.0]), scenario=scenario
            )
            rows = [
                np.concatenate([flight.state, flight.state_estimate, flight.rotor_speeds])
                for flight in (flight.advance(0.1 * k) for k in range(1, 21))
            ]
            return np.array(rows)

        one, again, other = fly(1), fly(1), fly(2)
        assert np.all(np.isfinite(one))
        assert one.tobytes() == again.tobytes()
        assert not np.any(one[:, 4:13] == other[:, 4:13])


class TestMovingGates:
    MOVING = DisturbancesConfig(gate_shift=1.0)

    def flight(self, shift, start, speeds=HOVER_SPEED, **scenario):
        """A flight in which gate 1 has moved by a shift, [x, y]."""
        scenario = Scenario(disturbances=self.MOVING, **scenario)
        flight = Flight(np.full(4, speeds), start, racing=True, scenario=scenario)
        self.move(flight, shift)
        return flight

    @staticmethod
    def move(flight, shift):
        mover = flight.simulation.GetSubsystemByName("gate_mover")
        root = flight.simulator.get_mutable_context()
        mover.GetMyMutableContextFromRoot(root).SetDiscreteState(1, [*shift, *np.zeros(18)])
        MakeMonitor(flight.simulation)(root)

    @staticmethod
    def camera_image(flight):
        context = flight.simulator.get_mutable_context()
        flight.simulator.Initialize()  # which takes a picture
        assert context.get_time() == 0.0
        return flight.camera_image.data.copy()

    @pytest.mark.parametrize(
        "p, v, shift, reason",
        [
            ([14.0, 5.0, 6.25], [15, 0, 0], [0.0, 0.0], "touched board_0"),
            ([14.0, 5.0, 6.25], [15, 0, 0], [0.0, -3.0], None),
            ([14.0, 2.0, 6.25], [15, 0, 0], [0.0, 0.0], None),
            ([14.0, 2.0, 6.25], [15, 0, 0], [0.0, -3.0], "touched board_0"),
            ([14.0, -2.0, 2.0], [15, 0, 0], [0.0, 0.0], None),
            ([14.0, -2.0, 2.0], [15, 0, 0], [0.0, 3.0], "touched pylon_1_right"),
        ],
    )
    def test_it_is_touched_where_it_stands(self, p, v, shift, reason):
        flight = self.flight(shift, start_at(p, v)).advance(0.6)
        assert flight.report.dnf_reason == reason
        if reason is None:
            assert flight.state[4] > 21.5  # and it is through

    def test_a_contact_pushes(self):
        """The plant's, not only the referee's: the drone bounces off a board that moved there."""
        start = start_at([14.0, 2.0, 6.25], [15, 0, 0])
        assert self.flight([0.0, -3.0], start).advance(0.6).state[10] < 5.0
        assert self.flight([0.0, 0.0], start).advance(0.6).state[10] > 14.0

    def test_it_is_passed_where_it_stands(self):
        start = start_at([17.0, 0.5, 6.25], [10, 0, 0])
        flight = self.flight([1.0, 1.0], start).advance(0.5)
        (crossing,) = flight.report.crossings
        assert crossing.time == pytest.approx(0.4, abs=0.01)
        assert crossing.offset == pytest.approx(0.5, abs=0.05)

    @pytest.mark.slow
    @pytest.mark.parametrize("renderer", RENDERERS)
    def test_it_is_seen_where_it_stands(self, tmp_path, renderer):
        if renderer == "vtk":
            try:
                check_vtk_available()
            except UserError as e:
                pytest.skip(str(e))
        track = load_track("student-airrace")
        shifts = np.zeros((10, 2))
        shifts[0] = [0.5, -2.0]
        (tmp_path / "moved.yaml").write_text(yaml_dump_typed(track.shifted(shifts)))
        camera = CameraConfig(renderer=renderer, preset="clean", width=320, height=180)
        start = start_at([0.0, 0.0, 5.0])
        still, moved = (
            self.camera_image(self.flight(shift, start, camera=camera))
            for shift in ([0.0, 0.0], shifts[0])
        )
        there = self.camera_image(
            Flight(
                np.zeros(4),
                start,
                scenario=Scenario(track=str(tmp_path / "moved.yaml"), camera=camera),
            )
        )
        assert np.mean(moved != still) > 0.01
        np.testing.assert_array_equal(moved, there)
        plain = Flight(np.zeros(4), start, scenario=Scenario(camera=camera))
        np.testing.assert_array_equal(still, self.camera_image(plain))

    def test_spectators_see_it(self):
        meshcat = Meshcat()
        scenario = Scenario(disturbances=self.MOVING, camera=CameraConfig(width=64, height=36))
        flight = Flight(np.zeros(4), scenario=scenario, meshcat=meshcat)

        def place(gate):
            packed = meshcat._GetPackedTransform(f"visualizer/gates/gate_{gate}")
            # MessagePack: after the word, three bytes and 16 numbers, column by column.
            numbers = packed.partition(b"matrix")[2][3:]
            matrix = np.frombuffer(numbers, np.dtype([("", "u1"), ("x", ">f8")]))["x"]
            return matrix.reshape(4, 4).T[:3, 3].tolist()

        flight.advance(0.05)
        assert place(1) == place(2) == [0.0, 0.0, 0.0]
        self.move(flight, [0.5, -0.25])
        flight.advance(0.1)
        assert place(1) == [0.5, -0.25, 0.0] and place(2) == [0.0, 0.0, 0.0]

    def test_gates_that_stand_still_cost_nothing(self):
        flight = Flight(np.zeros(4))
        assert not flight.simulation.HasSubsystemNamed("gate_mover")
        assert not flight.simulation.HasOutputPort("truth.gate_shifts")
        assert flight.simulation.GetSubsystemByName("plant").num_bodies() == 2
        before = flight.simulator.get_context().Clone()
        MakeMonitor(flight.simulation)(flight.simulator.get_mutable_context())
        np.testing.assert_array_equal(
            flight.state,
            flight.simulation.GetOutputPort("truth.state").Eval(
                flight.simulation.GetMyContextFromRoot(before)
            ),
        )

    def test_it_flies_as_before(self):
        """Bodies that can be moved, and are not, change nothing."""
        start = start_at([0.0, 0.0, 5.0], [3.0, 1.0, 0.0], [0.1, 0.2, 0.3])
        rows = [
            Flight(np.full(4, HOVER_SPEED), start, scenario=Scenario(disturbances=config))
            .advance(0.5)
            .state
            for config in (self.MOVING, DisturbancesConfig())
        ]
        np.testing.assert_allclose(*rows, rtol=0, atol=1e-9)
