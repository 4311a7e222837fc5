import base64

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydrake.math import RigidTransform
from scipy.spatial.transform import Rotation

from airrace.recording import race_events as events
from airrace.recording.foxglove_messages import raw_pixels
from airrace.systems.sensing.camera_view import CameraView
from airrace.systems.types import Detection, Detections, ExplorerEvent, ExplorerStatus, GateCrossing
from airrace.track import load_track
from airrace.track.gate_map import GateMap, MarkerEstimate
from airrace.trajopt.body_frames import SPACING, body_frames
from airrace.vehicle import GRAVITY, load_vehicle
from airrace.vehicle.camera_info import make_camera_info
from airrace.vehicle.state import State, as_plant_state
from airrace.visualization.page_sink import PageSink, estimate_data, plan_points
from airrace.visualization.race_record import FRAME, RaceRecord
from tests.visualization.meshcat_tools import Watching, drawn, plan

TRUTH = np.array([1.0, 0, 0, 0, 0, 0, 3.0, 0, 0, 0, 3.0, 4.0, 0.0])
PICTURE = np.random.default_rng(0).integers(0, 255, (720, 1280), np.uint8)
VEHICLE = load_vehicle("Default")[0]


def camera_info(k1=0.0):
    return make_camera_info(
        width=1280, height=720, fov_y=1.0, X_BC=VEHICLE.camera.X_BC, D=[k1, 0.0, 0.0, 0.0, 0.0]
    )


@pytest.fixture
def shown(hexagon):
    """Returns what a page shows of some events."""

    def shown(*happened, **options):
        record = RaceRecord()
        sink = PageSink(record, load_track(hexagon), VEHICLE, **options)
        for event in happened:
            sink.take(event)
        return record.whole()

    return shown


def sample(time, **fields):
    return events.StateSample(time, as_plant_state(TRUTH)._replace(time=time), **fields)


def frames(batch):
    rows = np.frombuffer(base64.b64decode(batch["frames"]), "<f4").reshape(-1, len(FRAME))
    return dict(zip(FRAME, rows.T))


def test_frames_are_the_truth_and_not_too_many(shown):
    hover = np.sqrt(VEHICLE.mass * GRAVITY / VEHICLE.thrust_coefficients.sum())
    q, p, w, v = as_plant_state(TRUTH)[1:]
    known = dict(rotor_speeds=np.full(4, hover), filtered=State(0.0, q, p + [0.3, 0.0, 0.4], w, v))
    made = frames(shown(*(sample(0.02 * k, **known) for k in range(5))))
    np.testing.assert_allclose(made["time"], [0.0, 0.04, 0.08], rtol=1e-6)
    np.testing.assert_allclose(made["z"], 3.0)
    np.testing.assert_allclose(made["speed"], 5.0)
    np.testing.assert_allclose(made["thrust"], 1.0, rtol=1e-6)
    np.testing.assert_allclose(made["error"], 0.5, rtol=1e-5)


def test_before_the_first_estimate_there_is_no_error(shown):
    nothing = State(0.0, np.zeros(4), *np.zeros((3, 3)))
    made = frames(shown(sample(0.0, filtered=nothing)))
    assert made["error"] == made["thrust"] == 0.0


def test_what_happens_is_shown_once(shown):
    entered = [ExplorerEvent(0.0, state, "why") for state in ("TAKE_OFF", "FLY_TO_GATE")]
    crossing = GateCrossing(time=0.12, gate=1, lap=1, offset=0.25, max_speed=9.0)
    first = ExplorerStatus(state="TAKE_OFF")
    then = ExplorerStatus(state="FLY_TO_GATE", gates=(0,))
    made = shown(
        events.ExplorerChanged(0.0, first, tuple(entered[:1])),
        events.PlanMade(0.1, plan(1)),
        events.ExplorerChanged(0.1, then, tuple(entered[1:])),
        events.ExplorerChanged(0.2, then, ()),
        events.GateCrossed(0.2, crossing),
        events.ClockWaits(0.3, 0.1, True),
        events.ClockWaits(0.4, 0.25, False),
        events.ClockWaits(0.6, 0.35, False),
    )
    assert [(each["state"], each["gates"], each["racing"]) for each in made["status"]] == [
        ("TAKE_OFF", 0, False),
        ("TAKE_OFF", 0, True),
        ("FLY_TO_GATE", 1, True),
    ]
    assert made["crossings"] == [{"t": 0.12, "gate": 1, "lap": 1}]
    (planned,) = made["plans"]
    assert (planned["lap"], planned["t"]) == (1, 0.1)
    assert [event["text"] for event in made["events"]] == [
        "take off: why",
        "plan for lap 1: 4.00 s",
        "fly to gate: why",
        "gate 1: 0.25 m off its middle",
        "the clock waited 0.25 s here",
        "the clock waited 0.10 s here",
    ]


def test_points_of_a_plan_are_on_it():
    points = plan_points(plan(1))
    assert points.shape[1] == 3 and len(points) > 40
    np.testing.assert_allclose(points[:, 2], 5.0)
    on_side = np.isclose(points[:, :2] % 10.0, 0.0, atol=1e-6).any(axis=1)
    assert on_side.mean() > 0.9  # the splines round the corners


def test_arrows_stand_along_the_plan(shown, meshcat):
    shown(meshcat=meshcat)
    assert not meshcat.HasPath("plans")
    shown(events.PlanMade(0.0, plan(1)), events.PlanMade(5.0, plan(3)), meshcat=meshcat)
    assert [meshcat.HasPath(f"plans/lap_{lap}") for lap in (1, 2, 3)] == [True, False, True]
    circuit = plan(1).circuit
    places = body_frames(circuit.sample(np.linspace(0.0, circuit.duration, 1000))).positions
    geometry = drawn(meshcat, "plans/lap_1")["object"]["geometries"][0]["data"]
    array = geometry["attributes"]["position"]["array"]
    vertices = np.frombuffer(array, np.float32).reshape(-1, 3)
    # Two arrows of ten vertices every three metres; an arrow's foot is where the drone is.
    n = places.shape[1]
    assert n == pytest.approx(40.0 / SPACING, abs=1.0) and len(vertices) == 20 * n
    feet = vertices.reshape(2, n, 10, 3)[:, :, :3].mean(axis=2)
    np.testing.assert_allclose(feet[0], places.T, atol=0.05)
    np.testing.assert_allclose(feet[1], feet[0], atol=1e-5)


def test_gates_that_move(shown, hexagon):
    made = shown(events.GatesMoved(0.0, np.zeros(12)), events.GatesMoved(0.2, np.ones(12)))
    first, second = made["shifts"]
    middles = [gate.p_WG[:2] for gate in load_track(hexagon).gates]
    np.testing.assert_allclose(first["gates"], middles, atol=0.01)
    np.testing.assert_allclose(np.subtract(second["gates"], first["gates"]), 1.0)


def test_of_a_map_only_those_markers_are_shown_that_change_to_the_eye(shown):
    def changed(time, *places):
        markers = (
            MarkerEstimate(id, 1, 0, np.array([x, 2.0, 3.0]), np.full(3, 1e-4), np.eye(3)[0])
            for id, x in places
        )
        return events.MapChanged(time, GateMap(markers=tuple(markers)))

    made = shown(
        changed(0.0), changed(1.0, (4, 1.0), (5, 1.0)), changed(2.0, (4, 1.001), (5, 1.1))
    )["maps"]
    assert made[0]["changed"] == [[4, 1, 2, 3, 1, 1, 1], [5, 1, 2, 3, 1, 1, 1]]
    assert made[0]["sigma"] == 0.01
    assert made[1]["changed"] == [[5, 1.1, 2, 3, 1, 1, 1]] and len(made) == 2


CORNERS = np.array([[400.0, 300], [500, 300], [500, 400], [400, 400]])


def pictured(taken, seen, info=None):
    """What is seen while a picture is shown."""
    marker = Detection(4, CORNERS, RigidTransform([0, 0, 10.0]), 0.1)
    return (
        sample(taken),
        events.DetectionsSeen(taken, Detections(seen, (marker,))),
        events.Picture(taken, taken, CameraView.of(PICTURE), info or camera_info()),
    )


def test_it_is_the_very_picture_that_the_detector_is_given(shown):
    (picture,) = shown(*pictured(0.0, 0.0))["pictures"]
    jpeg = np.frombuffer(base64.b64decode(picture["jpeg"]), np.uint8)
    small = cv2.resize(PICTURE, (320, 180), interpolation=cv2.INTER_AREA)
    decoded = cv2.imdecode(jpeg, cv2.IMREAD_GRAYSCALE)
    assert np.abs(decoded.astype(int) - small).mean() < 12.0
    (marker,) = picture["markers"]
    # Straight ahead of the camera is along x of a drone that looks that way.
    assert marker["id"] == 4 and marker["p"] == pytest.approx([10, 0, 3], abs=0.5)


def test_markers_of_another_picture_are_not_framed(shown):
    (picture,) = shown(*pictured(0.0, -1 / 30))["pictures"]
    assert picture["markers"] == []


@pytest.mark.parametrize("k1", [0.0, -0.2])
def test_markers_are_framed_where_the_camera_took_them(shown, k1):
    """Through a lens that distorts, too."""
    (picture,) = shown(*pictured(0.0, 0.0, camera_info(k1)))["pictures"]
    corners = raw_pixels(CORNERS, camera_info(k1))
    framed = np.reshape(picture["markers"][0]["corners"], (4, 2)) * [1280, 720] - 0.5
    np.testing.assert_allclose(framed, corners, atol=0.1)
    assert (k1 == 0.0) == np.allclose(corners[0], [400, 300])


@pytest.mark.parametrize(
    "watching, keep, count", [(False, False, 0), (False, True, 5), (True, False, 10)]
)
def test_pictures_are_for_somebody(shown, watching, keep, count):
    moments = [event for k in range(10) for event in pictured(0.2 * k, 0.2 * k)]
    made = shown(*moments, audience=Watching(watching), keep_pictures=keep)
    assert len(made["pictures"]) == count


def test_an_estimate_is_shown_with_its_ellipsoid(shown):
    error = np.array([0.0, 0, 0, -0.3, 0.0, -0.4, 0, 0, 0])
    covariance = np.diag([*[1e-6] * 3, 0.01, 0.04, 0.09, *[0.1] * 3])
    unknown = np.full(9, np.nan)
    made = shown(
        events.EstimateMade(0.0, unknown, covariance),
        *(events.EstimateMade(0.1 + k / 30, error, covariance) for k in range(6)),
    )["estimates"]
    assert [each["t"] for each in made] == [0.1, 0.2]
    assert made[0]["offset"] == [0.3, 0.0, 0.4]
    assert sorted(made[0]["radii"]) == pytest.approx([0.3, 0.6, 0.9])
    assert made[0]["sigma"] == 0.3


@given(arrays(float, (3, 3), elements=st.floats(-2.0, 2.0)))
def test_the_ellipsoid_is_that_of_the_covariance(root):
    covariance = root @ root.T + 1e-3 * np.eye(3)
    data = estimate_data(np.zeros(9), covariance)
    R = Rotation.from_quat(data["axes"]).as_matrix()
    again = R @ np.diag((np.array(data["radii"]) / 3.0) ** 2) @ R.T
    np.testing.assert_allclose(again, covariance, atol=2e-3 * np.trace(covariance))
