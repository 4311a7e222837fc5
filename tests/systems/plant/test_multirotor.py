import contextlib
import dataclasses as dc
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.geometry import Role
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource

from airrace.common.errors import UserError
from airrace.systems.plant.drag import Drag
from airrace.systems.plant.multirotor import (
    AddMultirotor,
    AddMultirotorModel,
    ApplyForces,
    ground_clearance,
)
from airrace.vehicle import DRONES, GRAVITY, load_vehicle
from airrace.vehicle.disturbances import DisturbancesConfig, true_vehicle

VEHICLE, SDF = load_vehicle("Default")
DT = 0.001


class Drone:
    """A drone in empty space, in drag if it has a wind."""

    def __init__(self, vehicle=VEHICLE, sdf=SDF, dt=DT, wind=None, truth=None):
        builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(builder, dt)
        self.body = AddMultirotorModel(self.plant, vehicle, sdf, truth)
        self.plant.Finalize()
        forces = []
        if wind is not None:
            drag = builder.AddSystem(Drag(vehicle=vehicle, share=1.0, body_index=self.body.index()))
            air = builder.AddSystem(ConstantVectorSource(wind))
            builder.Connect(self.plant.get_state_output_port(), drag.GetInputPort("state"))
            builder.Connect(air.get_output_port(), drag.GetInputPort("wind"))
            forces.append(drag.GetOutputPort("spatial_forces"))
        self.rotors, thrusts = AddMultirotor(builder, self.body, self.scene_graph, truth or vehicle)
        ApplyForces(builder, self.plant, [thrusts, *forces])
        builder.ExportInput(self.rotors.GetInputPort("rotor_speed_command"), "command")
        self.diagram = builder.Build()


SHIPPED = {name: Drone(*load_vehicle(name)) for name in DRONES}
each = pytest.mark.parametrize("name", DRONES)


@each
@settings(max_examples=30)
@given(st.data())
def test_the_plant_feels_what_the_allocation_says(name, data):
    """One step from rest, against Newton and Euler."""
    drone, (vehicle, _) = SHIPPED[name], load_vehicle(name)
    n = len(vehicle.rotors)
    shares = data.draw(st.lists(st.floats(0, 1), min_size=n, max_size=n))
    speeds = vehicle.max_speeds * shares
    simulator = Simulator(drone.diagram)
    context = simulator.get_mutable_context()
    drone.diagram.get_input_port().FixValue(context, speeds)
    drone.rotors.set_speeds(drone.rotors.GetMyMutableContextFromRoot(context), speeds)
    simulator.AdvanceTo(1.5 * DT)
    velocities = drone.plant.GetVelocities(drone.plant.GetMyContextFromRoot(context))
    f, *moment = vehicle.allocation @ (vehicle.thrust_coefficients * np.square(speeds))
    # The second step, at t = 1 ms, turns the thrust by less than is seen here.
    steps = 2
    np.testing.assert_allclose(
        velocities[:3], steps * DT * np.array(moment) / vehicle.inertia, atol=2e-3
    )
    np.testing.assert_allclose(velocities[3:5], 0, atol=1e-3)
    assert velocities[5] == pytest.approx(steps * DT * (f / vehicle.mass - GRAVITY), abs=1e-3)


@each
def test_the_camera_does_not_see_its_own_drone(name):
    drone = SHIPPED[name]
    inspector = drone.scene_graph.model_inspector()
    frame = drone.plant.GetBodyFrameIdOrThrow(drone.body.index())
    assert inspector.GetGeometries(frame, Role.kPerception) == []
    assert len(inspector.GetGeometries(frame, Role.kIllustration)) > 4


@each
def test_the_model_is_as_large_as_the_vehicle_says(name):
    """What can be hit covers the propellers, and every rotor is drawn where it is."""
    drone, (vehicle, _) = SHIPPED[name], load_vehicle(name)
    inspector = drone.scene_graph.model_inspector()
    guards = [
        (inspector.GetPoseInFrame(i).translation(), inspector.GetShape(i).radius())
        for i in drone.plant.GetCollisionGeometriesForBody(drone.body)
    ]
    drawn = {inspector.GetName(i): i for i in inspector.GetAllGeometryIds(Role.kIllustration)}
    rim = np.linspace(0.0, 2 * np.pi, 60)
    for i, rotor in enumerate(vehicle.rotors, 1):
        disc = drawn[f"drone::rotor_{i}"]
        hub = inspector.GetPoseInFrame(disc).translation()
        np.testing.assert_allclose(hub, rotor.position, atol=0.03)
        assert inspector.GetShape(disc).radius() == rotor.radius
        edge = hub + rotor.radius * np.column_stack([np.cos(rim), np.sin(rim), 0 * rim])
        assert any(
            np.linalg.norm(edge - centre, axis=1).max() < radius + 0.004
            for centre, radius in guards
        )


SHAPES = {
    "<sphere><radius>0.1</radius></sphere>": 0.1,
    "<box><size>0.6 0.4 0.2</size></box>": 0.1,
    "<cylinder><radius>0.3</radius><length>0.2</length></cylinder>": 0.1,
    "<capsule><radius>0.3</radius><length>0.2</length></capsule>": 0.4,
    "<ellipsoid><radii>0.3 0.2 0.1</radii></ellipsoid>": 0.1,
    "<plane><normal>0 0 1</normal><size>1 1</size></plane>": None,
}


class TestGroundClearance:
    def clearance(self, tmp_path, *collisions):
        text = re.sub("<collision.*</collision>", "%s", SDF.read_text(), flags=re.S)
        (tmp_path / "mine.sdf").write_text(
            text
            % "".join(
                f'<collision name="c{i}"><pose>{pose}</pose><geometry>{shape}</geometry></collision>'
                for i, (pose, shape) in enumerate(collisions)
            )
        )
        plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), DT)
        body = AddMultirotorModel(plant, VEHICLE, tmp_path / "mine.sdf")
        return ground_clearance(body, scene_graph)

    @pytest.mark.parametrize("shape, height", SHAPES.items(), ids=[s[1:9] for s in SHAPES])
    def test_of_every_shape(self, tmp_path, shape, height):
        if height is None:
            with pytest.raises(UserError, match="nothing to stand on"):
                self.clearance(tmp_path, ("0 0 0 0 0 0", shape))
        else:
            for pose in ("0 0 0 0 0 0", "0 0 0 3.14159265359 0 1"):
                assert self.clearance(tmp_path, (pose, shape)) == pytest.approx(height)

    def test_the_lowest_counts(self, tmp_path):
        sphere, box, cylinder = list(SHAPES)[:3]
        assert self.clearance(
            tmp_path,
            ("0 0 0.5 0 0 0", sphere),
            ("1 0 -0.3 0 1.57079632679 0", box),
            ("0 0 1 0 0 0", cylinder),
        ) == pytest.approx(0.6)

    def test_of_a_slanted_leg(self, tmp_path):
        leg = "<cylinder><radius>0.01</radius><length>0.4</length></cylinder>"
        height = self.clearance(tmp_path, ("0 0 0 0.5 0 0", leg))
        assert height == pytest.approx(0.2 * np.cos(0.5) + 0.01 * np.sin(0.5))


def command(vehicle, time):
    """Every rotor about its hover speed, at its own pace: the moments tumble the drone."""
    hover = np.sqrt(vehicle.mass * GRAVITY / vehicle.thrust_coefficients.sum())
    pace = 1.0 + 0.3 * np.arange(len(vehicle.rotors))  # Hz
    return hover * (1.0 + 0.05 * np.sin(2 * np.pi * pace * time))


class Command(LeafSystem):
    def __init__(self, vehicle):
        LeafSystem.__init__(self)
        self._vehicle = vehicle
        self.DeclareVectorOutputPort("command", len(vehicle.rotors), self._calc)

    def _calc(self, context, output):
        output.set_value(command(self._vehicle, context.get_time()))


def fly(vehicle, sdf, start, duration, dt, wind):
    """Returns the state of the plant that flies the command."""
    drone = Drone(vehicle, sdf, dt, wind)
    builder = DiagramBuilder()
    builder.AddSystem(drone.diagram)
    source = builder.AddSystem(Command(vehicle))
    builder.Connect(source.get_output_port(), drone.diagram.get_input_port())
    simulator = Simulator(builder.Build())
    context = drone.plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    drone.plant.SetPositionsAndVelocities(context, start)
    simulator.AdvanceTo(duration + 0.5 * dt)
    return drone.plant.GetPositionsAndVelocities(context)


def integrate(vehicle, start, duration, dt, wind):
    """Returns what fly() tends to, by Runge and Kutta's method of fourth order.

    The state of the equations is q, p, w_WB in B, v in W, and the rotors' speeds.
    """
    J, drag = np.array(vehicle.inertia), vehicle.drag

    def derivative(time, y):
        q, w, v, speeds = y[:4], y[7:10], y[10:13], y[13:]
        thrust, *moment = vehicle.allocation @ (vehicle.thrust_coefficients * speeds**2)
        R = matrix(q)
        force = np.array([0.0, 0.0, thrust])
        moment = moment - np.cross(w, J * w)
        if wind is not None:
            u = R.T @ (v - wind)
            force -= (drag.linear + np.multiply(drag.quadratic, np.linalg.norm(u))) * u
            moment -= np.multiply(drag.angular, w)
        return np.concatenate(
            [
                0.5 * np.array([-q[1:] @ w, *(q[0] * w + np.cross(q[1:], w))]),
                v,
                moment / J,
                R @ force / vehicle.mass - [0.0, 0.0, GRAVITY],
                (command(vehicle, time) - speeds) / vehicle.rotor_lag,
            ]
        )

    w = matrix(start[:4]).T @ start[7:10]
    y = np.concatenate([start[:7], w, start[10:], np.zeros(len(vehicle.rotors))])
    for time in dt * np.arange(round(duration / dt)):
        a = derivative(time, y)
        b = derivative(time + dt / 2, y + dt / 2 * a)
        c = derivative(time + dt / 2, y + dt / 2 * b)
        d = derivative(time + dt, y + dt * c)
        y = y + dt / 6 * (a + 2 * b + 2 * c + d)
    return np.concatenate([y[:7], matrix(y[:4]) @ y[7:10], y[10:13]])


def matrix(q):
    w, x, y, z = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def distances(state, other):
    """How far two states are apart: attitude (rad), position, angular velocity, velocity."""
    cosine = (np.trace(matrix(state[:4]) @ matrix(other[:4]).T) - 1) / 2
    parts = (slice(4, 7), slice(7, 10), slice(10, 13))
    return np.array([np.arccos(cosine), *(np.linalg.norm((state - other)[s]) for s in parts)])


@pytest.mark.slow
@pytest.mark.parametrize("wind", [None, np.array([5.0, -4.0, 2.0])], ids=["vacuum", "wind"])
@pytest.mark.parametrize("drone", DRONES)
def test_the_plant_against_our_own_integration(drone, wind):
    """A second of tumbling, with the rotors never at rest.

    The plant's method is of first order: half the step is half the error.
    """
    vehicle, sdf = load_vehicle(drone)
    start = np.array([1, 0, 0, 0, 0, 0, 0, 2.0, -1.5, 1.0, 4.0, -3.0, 1.0])
    exact = integrate(vehicle, start, 1.0, DT, wind)
    assert distances(exact, start)[0] > 1.5  # it does tumble
    errors = distances(fly(vehicle, sdf, start, 1.0, DT, wind), exact)
    assert np.all(errors < [0.005, 0.02, 0.006, 0.02])
    finer = distances(fly(vehicle, sdf, start, 1.0, DT / 2, wind), exact)
    np.testing.assert_allclose(errors / finer, 2.0, rtol=0.015)  # vadr's rotors lag by ten steps


@pytest.mark.parametrize("wind", [[0.0, 0.0, 0.0], [6.0, 0.0, 0.0]])
@pytest.mark.parametrize("drone", DRONES)
def test_terminal_velocity(drone, wind):
    """A fall with its rotors at rest, until drag carries the weight."""
    vehicle, sdf = load_vehicle(drone)
    fall = Drone(vehicle, sdf, dt=0.01, wind=np.array(wind))
    simulator = Simulator(fall.diagram)
    context = simulator.get_mutable_context()
    fall.diagram.get_input_port().FixValue(context, np.zeros(len(vehicle.rotors)))
    simulator.AdvanceTo(60.0)
    velocity = fall.plant.GetVelocities(fall.plant.GetMyContextFromRoot(context))[3:]
    # It has drifted with the wind: what is left is m g = (linear + quadratic v) v.
    linear, quadratic = vehicle.drag.linear[2], vehicle.drag.quadratic[2]
    weight = vehicle.mass * GRAVITY
    speed = (np.sqrt(linear**2 + 4 * quadratic * weight) - linear) / (2 * quadratic)
    np.testing.assert_allclose(velocity, [wind[0], 0.0, -speed], atol=1e-5)


class TestTruth:
    """The drone that flies may differ from its file."""

    CONFIG = DisturbancesConfig(mass_error=0.3, inertia_error=0.3, thrust_coefficient_error=0.3)

    @pytest.mark.parametrize("drone", DRONES)
    def test_the_plant_has_the_true_mass_and_inertia(self, drone):
        vehicle, sdf = load_vehicle(drone)
        truth = true_vehicle(vehicle, self.CONFIG, seed=1)
        assert abs(truth.mass / vehicle.mass - 1.0) > 0.001
        nominal, true = (Drone(vehicle, sdf, truth=t) for t in (None, truth))
        M = true.body.default_spatial_inertia()
        assert M.get_mass() == pytest.approx(truth.mass, rel=1e-12)
        np.testing.assert_allclose(
            M.CalcRotationalInertia().CopyToFullMatrix3(), np.diag(truth.inertia), atol=1e-15
        )

        # Nothing else of the model has changed.
        def shapes(drone):
            inspector = drone.scene_graph.model_inspector()
            return [
                (
                    inspector.GetName(i),
                    str(inspector.GetShape(i)),
                    inspector.GetPoseInFrame(i).GetAsMatrix4().tolist(),
                )
                for i in inspector.GetAllGeometryIds()
            ]

        assert shapes(true) == shapes(nominal)

    def test_its_rotors_push_as_they_truly_do(self):
        truth = true_vehicle(VEHICLE, self.CONFIG, seed=1)
        bank = Drone(truth=truth).rotors
        context = bank.CreateDefaultContext()
        bank.set_speeds(context, [50.0, 60.0, 70.0, 80.0])
        np.testing.assert_allclose(
            bank.GetOutputPort("thrusts").Eval(context),
            truth.thrust_coefficients * np.square([50.0, 60.0, 70.0, 80.0]),
        )

    def test_files_that_the_model_names_are_found(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        mesh = "<mesh><uri>hull shape.obj</uri></mesh>"
        text = SDF.read_text()
        ellipsoid = text[text.index("<ellipsoid>") : text.index("</ellipsoid>")] + "</ellipsoid>"
        model = tmp_path / "models" / "mine.sdf"
        model.parent.mkdir()
        model.write_text(text.replace(ellipsoid, mesh))
        (model.parent / "hull shape.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
        truth = true_vehicle(VEHICLE, self.CONFIG, seed=1)
        drone = Drone(sdf=model.relative_to(tmp_path), truth=truth)
        inspector = drone.scene_graph.model_inspector()
        sources = [
            inspector.GetShape(i).source().path()
            for i in inspector.GetAllGeometryIds()
            if type(inspector.GetShape(i)).__name__ == "Mesh"
        ]
        assert sources == [model.parent / "hull shape.obj"]


@pytest.mark.parametrize("error", [0.0, 0.1])
@pytest.mark.parametrize("change", [dict(mass=1.1), dict(inertia=[0.01, 0.011, 0.018])])
def test_a_model_that_contradicts_its_vehicle_is_refused(change, error):
    plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), DT)
    vehicle = dc.replace(VEHICLE, **change)
    truth = true_vehicle(vehicle, DisturbancesConfig(mass_error=error, inertia_error=error), 0)
    with pytest.raises(
        UserError, match="mass of 1 kg, and its vehicle.yaml 1.1 kg|moments of inertia .* 0.011,"
    ):
        AddMultirotorModel(plant, vehicle, SDF, truth)


@pytest.mark.parametrize("truth", [None, dc.replace(VEHICLE, mass=1.2)])
@pytest.mark.parametrize("text", ["", "<sdf", "<sdf version='1.9'/>"])
def test_what_is_no_model_is_refused(tmp_path, text, truth):
    (tmp_path / "drone.sdf").write_text(text)
    plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), DT)
    with pytest.raises(UserError, match="drone.sdf cannot be used: ") as e:
        AddMultirotorModel(plant, VEHICLE, tmp_path / "drone.sdf", truth)
    assert "\n" not in str(e.value)


def test_drakes_warnings_are_shown_unless_the_model_is_refused(tmp_path, caplog):
    model = tmp_path / "drone.sdf"
    odd = SDF.read_text().replace("</link>", '<sensor name="s" type="imu"/></link>')
    for text, warnings in ((odd, 1), (odd.replace("<mass>1.0", "<mass>nan"), 0)):
        model.write_text(text)
        caplog.clear()
        plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), DT)
        with contextlib.suppress(UserError):
            AddMultirotorModel(plant, VEHICLE, model)
        assert len(caplog.records) == warnings
        assert all("unsupported SDFormat element" in r.getMessage() for r in caplog.records)
