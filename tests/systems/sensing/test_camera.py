"""The camera as a System: what it samples, when, and how often it draws."""

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, EventStatus
from pydrake.systems.primitives import VectorLogSink

from airrace.rendering.planar.renderer import PlanarRenderer
from airrace.systems.sensing.camera import Camera
from airrace.track import Gate, Track
from airrace.vehicle.camera_info import CameraInfo, make_camera_info
from airrace.vehicle.sensor_failures import CameraFailure

X_BC = RigidTransform(RotationMatrix(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])), [0.1, 0, 0])
INFO = make_camera_info(width=64, height=48, fov_y=1.0, X_BC=X_BC)
FPS = 8.0  # its multiples are exact in binary and steps of the plant


class RecordingRenderer:
    """Writes the number of the picture into it and remembers the poses."""

    needs_query_object = False

    def __init__(self):
        self.poses = []

    def render(self, X_WC, out):
        self.poses.append(X_WC)
        out[:] = len(self.poses)


def make_state(X_WB, scale=1.0):
    quaternion = X_WB.rotation().ToQuaternion().wxyz() * scale
    return np.concatenate([quaternion, X_WB.translation(), np.zeros(6)])


def make_camera(**kwargs):
    renderer = RecordingRenderer()
    return Camera(camera_info=INFO, fps=FPS, renderer=renderer, **kwargs), renderer


def sample(camera, context):
    """What happens at initialization and at every period."""
    camera.CalcForcedUnrestrictedUpdate(context, context.get_mutable_state())


def test_ports():
    camera, _ = make_camera()
    inputs = [camera.get_input_port(i).get_name() for i in range(camera.num_input_ports())]
    assert inputs == ["state", "seed"]
    outputs = [camera.get_output_port(i).get_name() for i in range(camera.num_output_ports())]
    assert outputs == [
        "camera_image",
        "camera_grey",
        "camera_view",
        "camera_image_time",
        "camera_info",
    ]
    # Nothing feeds through, so that the camera closes no algebraic loop.
    assert not camera.HasAnyDirectFeedthrough()


def test_picture_is_taken_from_the_sampled_pose():
    camera, renderer = make_camera()
    context = camera.CreateDefaultContext()
    X_WB = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [1.0, 2.0, 3.0])
    # The quaternion of an integrated state is not quite of unit length.
    camera.GetInputPort("state").FixValue(context, make_state(X_WB, scale=1.001))
    context.SetTime(0.7)
    sample(camera, context)
    image = camera.GetOutputPort("camera_image").Eval(context)
    assert (image.width(), image.height()) == (INFO.width, INFO.height)
    assert np.all(image.data == 1)
    assert renderer.poses[0].IsNearlyEqualTo(X_WB @ X_BC, 1e-12)
    assert camera.GetOutputPort("camera_image_time").Eval(context) == [0.7]
    assert camera.GetOutputPort("camera_info").Eval(context) is INFO


def test_one_sample_is_drawn_once_and_only_if_looked_at():
    camera, renderer = make_camera()
    context = camera.CreateDefaultContext()
    image = camera.GetOutputPort("camera_image")
    state = camera.GetInputPort("state")
    state.FixValue(context, make_state(RigidTransform()))
    sample(camera, context)
    assert not renderer.poses
    for _ in range(3):
        assert np.all(image.Eval(context).data == 1)
    # Time and pose go on; the sample does not.
    context.SetTime(0.05)
    state.FixValue(context, make_state(RigidTransform([1.0, 0.0, 0.0])))
    assert np.all(image.Eval(context).data == 1)
    assert camera.GetOutputPort("camera_image_time").Eval(context) == [0.0]
    sample(camera, context)
    assert np.all(image.Eval(context).data == 2)
    assert renderer.poses[1].IsNearlyEqualTo(RigidTransform([1.0, 0.0, 0.0]) @ X_BC, 1e-12)


def make_flight(**kwargs):
    """A free body moving along x at 1 m/s, and a camera on it."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=1e-3)
    plant.SetUseSampledOutputPorts(False)
    plant.AddRigidBody("body", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    plant.Finalize()
    camera, renderer = make_camera(**kwargs)
    builder.AddSystem(camera)
    builder.Connect(plant.get_state_output_port(), camera.GetInputPort("state"))
    time_log = builder.AddSystem(VectorLogSink(1, publish_period=0.01))
    builder.Connect(camera.GetOutputPort("camera_image_time"), time_log.get_input_port())
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetPositionsAndVelocities(context, [1, 0, 0, 0, 5.0, 6.0, 7.0, 0, 0, 0, 1.0, 0, 0])
    return simulator, camera, renderer, time_log


def test_first_sample_shows_the_initial_state():
    simulator, camera, renderer, _ = make_flight()
    simulator.Initialize()
    context = camera.GetMyContextFromRoot(simulator.get_context())
    assert camera.GetOutputPort("camera_image_time").Eval(context) == [0.0]
    camera.GetOutputPort("camera_image").Eval(context)
    assert renderer.poses[0].IsNearlyEqualTo(RigidTransform([5.0, 6.0, 7.0]) @ X_BC, 1e-12)
    # The first step takes the same sample again.
    simulator.AdvanceTo(0.05)
    camera.GetOutputPort("camera_image").Eval(context)
    assert renderer.poses[-1].IsExactlyEqualTo(renderer.poses[0])


def test_pictures_keep_their_period():
    simulator, camera, renderer, time_log = make_flight()
    context = camera.GetMyContextFromRoot(simulator.get_context())

    times = []

    def look(_):
        camera.GetOutputPort("camera_image").Eval(context)
        (time,) = camera.GetOutputPort("camera_image_time").Eval(context)
        times.append(time)
        return EventStatus.DidNothing()

    simulator.set_monitor(look)  # looks after each of the plant's steps
    simulator.AdvanceTo(0.95)
    assert np.array_equal(np.unique(times), np.arange(8) / FPS)
    # One picture a sample, but for t = 0; each from where the body was then.
    x = [pose.translation()[0] for pose in renderer.poses]
    assert np.allclose(x, 5.1 + np.array([0, *range(8)]) / FPS, rtol=0, atol=1e-9)
    log = time_log.FindLog(simulator.get_context())
    # A publish at t happens before the update at t.
    expected = np.maximum(np.ceil(log.sample_times() * FPS - 1e-9) - 1, 0) / FPS
    assert np.array_equal(log.data()[0], expected)


def test_latency_is_exact():
    """A picture is there one latency after its sample, which it still shows."""
    latency = 3 / 64
    simulator, camera, renderer, time_log = make_flight(latency=latency)
    context = camera.GetMyContextFromRoot(simulator.get_context())
    seen = {}

    def look(root):
        camera.GetOutputPort("camera_image").Eval(context)
        (time,) = camera.GetOutputPort("camera_image_time").Eval(context)
        x = renderer.poses[-1].translation()[0]
        seen.setdefault(time, (root.get_time(), x))
        return EventStatus.DidNothing()

    simulator.set_monitor(look)
    simulator.AdvanceTo(0.95)
    assert list(seen) == [k / FPS for k in range(8)]
    for time, (first_seen, x) in seen.items():
        assert abs(x - (5.1 + time)) < 1e-9
        if time > 0:  # the first picture is there from the beginning
            # The monitor looks after the plant's step that the update began.
            assert time + latency < first_seen <= time + latency + 1.1e-3
    # Each is drawn once, but for the first, which is sampled twice.
    assert len(renderer.poses) <= 9
    log = time_log.FindLog(simulator.get_context())
    behind = log.sample_times() - log.data()[0]
    assert behind[log.data()[0] > 0].min() > latency - 1e-9
    assert behind.max() <= latency + 1 / FPS + 1e-9


def test_imaging_is_given_the_sample_and_its_number():
    class Imaging:
        def picture(self, expose, X_WB, w_WB, v_WB, frame, seed):
            self.args = X_WB.translation().tolist(), w_WB.tolist(), v_WB.tolist(), frame
            return expose([(1.0, X_WB)], X_WB)

    imaging = Imaging()
    camera, _ = make_camera(imaging=imaging)
    context = camera.CreateDefaultContext()
    state = [1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9]
    camera.GetInputPort("state").FixValue(context, state)
    context.SetTime(5 / FPS)
    sample(camera, context)
    assert np.all(camera.GetOutputPort("camera_image").Eval(context).data == 1)
    assert imaging.args == ([1, 2, 3], [4, 5, 6], [7, 8, 9], 5)


def test_between_steps_of_the_plant_the_picture_is_of_its_own_time():
    """A drone that flies and turns, in steps that the pictures' times are no multiples of."""
    camera, renderer = make_camera(state_period=1e-3)
    context = camera.CreateDefaultContext()
    v, w = np.array([20.0, -3.0, 1.0]), np.array([0.0, 0.0, 4.0])
    for time, step in ((0.1, 0.1), (0.0333, 0.034), (0.0337, 0.034)):
        X_WB = RigidTransform(RollPitchYaw(0.0, 0.0, 4.0 * step), step * v)
        state = np.concatenate([make_state(X_WB)[:7], w, v])
        camera.GetInputPort("state").FixValue(context, state)
        context.SetTime(time)
        sample(camera, context)
        camera.GetOutputPort("camera_image").Eval(context)
        expected = RigidTransform(RollPitchYaw(0.0, 0.0, 4.0 * time), time * v) @ X_BC
        assert renderer.poses[-1].IsNearlyEqualTo(expected, 1e-9)


def test_nobody_looks_nothing_is_drawn():
    simulator, _, renderer, _ = make_flight()
    simulator.AdvanceTo(0.5)
    assert not renderer.poses


def test_geometry_query_reaches_a_renderer_that_needs_it():
    class QueryingRenderer:
        needs_query_object = True

        def render(self, X_WC, out, query_object):
            out[:] = query_object.inspector().num_geometries() + 42

    builder = DiagramBuilder()
    scene_graph = builder.AddSystem(SceneGraph())
    camera = builder.AddSystem(Camera(camera_info=INFO, fps=FPS, renderer=QueryingRenderer()))
    builder.Connect(scene_graph.get_query_output_port(), camera.GetInputPort("geometry_query"))
    builder.ExportInput(camera.GetInputPort("state"), "state")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    image = camera.GetOutputPort("camera_image").Eval(camera.GetMyContextFromRoot(context))
    assert np.all(image.data == 42)


def test_planar_pictures_through_the_system():
    track = Track(gates=[Gate(left_pylon=[20.0, 5.0], heading_deg=0.0)])
    camera = Camera(camera_info=INFO, fps=FPS, renderer=PlanarRenderer(track, INFO))
    context = camera.CreateDefaultContext()
    X_WB = RigidTransform([0.0, 0.0, 5.0])
    camera.GetInputPort("state").FixValue(context, make_state(X_WB))
    sample(camera, context)
    through_system = camera.GetOutputPort("camera_image").Eval(context).data
    direct = np.zeros((INFO.height, INFO.width, 4), np.uint8)
    PlanarRenderer(track, INFO).render(X_WB @ X_BC, direct)
    assert np.array_equal(through_system, direct)
    assert isinstance(camera.GetOutputPort("camera_info").Eval(context), CameraInfo)


def test_camera_info_port_holds_the_calibration():
    camera, _ = make_camera()
    value = camera.GetOutputPort("camera_info").Allocate()
    assert isinstance(value, Value[object])


def test_gates_are_drawn_where_they_stood_when_the_picture_was_taken():
    track = Track(gates=[Gate([20.0, 5.0], 0.0), Gate([40.0, 5.0], 0.0)])
    camera = Camera(camera_info=INFO, fps=FPS, renderer=PlanarRenderer(track, INFO), moving_gates=2)
    assert not camera.HasAnyDirectFeedthrough()
    context = camera.CreateDefaultContext()
    X_WB = RigidTransform([0.0, 0.0, 5.0])
    camera.GetInputPort("state").FixValue(context, make_state(X_WB))

    def take(shifts):
        camera.GetInputPort("gate_shifts").FixValue(context, np.ravel(shifts))
        sample(camera, context)
        return picture()

    def picture():
        return camera.GetOutputPort("camera_image").Eval(context).data.copy()

    def expected(shifts):
        direct = np.zeros((INFO.height, INFO.width, 4), np.uint8)
        PlanarRenderer(track.shifted(shifts), INFO).render(X_WB @ X_BC, direct)
        return direct

    still, moved = np.zeros((2, 2)), np.array([[0.0, 2.0], [-3.0, 0.0]])
    assert np.array_equal(take(still), expected(still))
    assert np.array_equal(take(moved), expected(moved))
    assert not np.array_equal(take(moved), take(still))
    # What comes after a sample does not change its picture.
    camera.GetInputPort("gate_shifts").FixValue(context, moved.ravel())
    assert np.array_equal(picture(), expected(still))


def test_only_a_renderer_without_a_scene_of_its_own_is_told_of_the_gates():
    assert make_camera(moving_gates=3)[0].GetInputPort("gate_shifts").size() == 6
    assert not make_camera()[0].HasInputPort("gate_shifts")
    renderer = RecordingRenderer()
    renderer.needs_query_object = True
    camera = Camera(camera_info=INFO, fps=FPS, renderer=renderer, moving_gates=3)
    assert not camera.HasInputPort("gate_shifts")


def test_pictures_that_were_taken_in_the_dark_are_black():
    failures = [CameraFailure("dark", 0.25, 0.25), CameraFailure("dark", 1.0)]
    camera, renderer = make_camera(failures=failures)
    context = camera.CreateDefaultContext()
    camera.GetInputPort("state").FixValue(context, make_state(RigidTransform()))
    dark = []
    for k in range(20):
        context.SetTime(k / FPS)
        sample(camera, context)
        image = camera.GetOutputPort("camera_image").Eval(context).data
        grey = camera.GetOutputPort("camera_grey").Eval(context).data
        view = camera.GetOutputPort("camera_view").Eval(context).whole()
        assert image.any() and np.array_equal(grey[..., 0], view)
        dark.append(not view.any())
        if dark[-1]:
            assert np.all(image == [0, 0, 0, 255])
    assert [k for k in range(20) if dark[k]] == [2, 3, *range(8, 20)]
    assert len(renderer.poses) == 2 * (20 - 14)  # in colour and in grey
