import base64

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from scipy.spatial.transform import Rotation

from airrace.recording.foxglove_messages import raw_pixels
from airrace.systems.estimation.kalman_update import Belief
from airrace.systems.estimation.slam_state import SlamState
from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.systems.sensing.camera_view import CameraView
from airrace.systems.types import (
    Detection,
    Detections,
    ExplorerEvent,
    ExplorerStatus,
    GateCrossing,
    RefereeStatus,
)
from airrace.track import load_track
from airrace.track.gate_map import GateMap, MarkerEstimate
from airrace.vehicle import GRAVITY, load_vehicle
from airrace.vehicle.camera_info import make_camera_info
from airrace.visualization.race_feed import (
    MapNews,
    RaceFeed,
    estimate_data,
    marker_data,
    plan_points,
)
from airrace.visualization.race_record import FRAME, RaceRecord
from tests.visualization.meshcat_tools import Watching, fix, plan

STATE = np.array([1.0, 0, 0, 0, 0, 0, 3.0, 0, 0, 0, 3.0, 4.0, 0.0])
PICTURE = np.random.default_rng(0).integers(0, 255, (720, 1280), np.uint8)
VEHICLE = load_vehicle("Default")[0]


@pytest.fixture
def info():
    return make_camera_info(width=1280, height=720, fov_y=1.0, X_BC=VEHICLE.camera.X_BC)


@pytest.fixture
def feed(hexagon):
    """Shows a RaceFeed one moment after the other; returns its record."""
    record = RaceRecord()

    def feed(*moments, keep=False, watching=False, camera=False, moving=False, vio=False):
        system = RaceFeed(
            record=record,
            track=load_track(hexagon),
            vehicle=VEHICLE,
            audience=Watching(watching),
            camera=camera,
            keep_pictures=keep,
            moving_gates=moving,
            estimates=vio,
        )
        simulator = Simulator(system)
        for k, values in enumerate(moments):
            fix(system, simulator.get_mutable_context(), **{"truth__state": STATE, **values})
            simulator.AdvanceTo(0.05 + 0.1 * k)
        return record.whole()

    return feed


def frames(batch):
    rows = np.frombuffer(base64.b64decode(batch["frames"]), "<f4").reshape(-1, len(FRAME))
    return dict(zip(FRAME, rows.T))


def test_frames_are_the_truth(feed):
    hover = np.sqrt(VEHICLE.mass * GRAVITY / VEHICLE.thrust_coefficients.sum())
    estimate = np.concatenate([[0.0], STATE])
    estimate[5:8] += [0.3, 0.0, 0.4]
    made = frames(feed(dict(rotor_speeds=np.full(4, hover), filtered_estimate=estimate)))
    np.testing.assert_allclose(made["time"], [0.0, 1 / 30], rtol=1e-6)
    np.testing.assert_allclose(made["z"], 3.0)
    np.testing.assert_allclose(made["speed"], 5.0)
    np.testing.assert_allclose(made["thrust"], 1.0, rtol=1e-6)
    np.testing.assert_allclose(made["error"], 0.5, rtol=1e-5)


def test_what_is_not_connected_is_not_told(feed):
    assert set(feed({})) == {"frames", "pictures"}


def test_news_are_told_once(feed):
    events = tuple(ExplorerEvent(0.0, state, "why") for state in ("TAKE_OFF", "FLY_TO_GATE"))
    first = ExplorerStatus(state="TAKE_OFF", events=events[:1])
    then = ExplorerStatus(state="FLY_TO_GATE", gates=(0,), events=events)
    crossing = GateCrossing(time=0.12, gate=1, lap=1, offset=0.25, max_speed=9.0)
    report = RefereeStatus((crossing,), False, None, None, 0)
    made = feed(
        dict(explorer_status=first, lap_plan=NO_PLAN),
        dict(explorer_status=then, lap_plan=plan(1)),
        dict(explorer_status=then, lap_plan=plan(1), truth__referee_status=report),
        dict(explorer_status=then, lap_plan=plan(1), truth__referee_status=report),
    )
    assert [(each["state"], each["gates"], each["racing"]) for each in made["status"]] == [
        ("TAKE_OFF", 0, False),
        ("FLY_TO_GATE", 1, True),
    ]
    assert made["crossings"] == [{"t": 0.12, "gate": 1, "lap": 1}]
    (told,) = made["plans"]
    assert (told["lap"], told["t"]) == (1, 0.1)
    assert sorted(event["text"] for event in made["events"]) == [
        "fly to gate: why",
        "gate 1, 0.25 m from its middle",
        "plan for lap 1: 4.00 s",
        "take off: why",
    ]


def test_points_of_a_plan_are_on_it():
    points = plan_points(plan(1))
    assert points.shape[1] == 3 and len(points) > 40
    np.testing.assert_allclose(points[:, 2], 5.0)
    on_side = np.isclose(points[:, :2] % 10.0, 0.0, atol=1e-6).any(axis=1)
    assert on_side.mean() > 0.9  # the splines round the corners


def test_gates_that_move(feed, hexagon):
    shifts = np.zeros(12)
    made = feed(
        dict(truth__gate_shifts=shifts),
        dict(truth__gate_shifts=shifts),
        dict(truth__gate_shifts=shifts + 1.0),
        moving=True,
    )
    first, second = made["shifts"]
    middles = [gate.p_WG[:2] for gate in load_track(hexagon).gates]
    np.testing.assert_allclose(first["gates"], middles, atol=0.01)
    np.testing.assert_allclose(np.subtract(second["gates"], first["gates"]), 1.0)


def test_only_markers_that_change_to_the_eye_are_told():
    news, p, v = MapNews(), np.array([1.0, 2, 3]), np.full(3, 1e-4)
    assert news.of([(4, p, v), (5, p, v)]) == {
        "sigma": 0.01,
        "changed": [[4, 1, 2, 3, 1, 1, 1], [5, 1, 2, 3, 1, 1, 1]],
    }
    assert news.of([(4, p + 0.001, v), (5, p + 0.1, v)])["changed"] == [[5, 1.1, 2.1, 3.1, 1, 1, 1]]


def test_a_map_is_told_once_a_second(feed):
    def gate_map(x):
        marker = MarkerEstimate(0, 1, 0, np.array([x, 0.0, 6.0]), np.full(3, 1e-6), np.eye(3)[0])
        return GateMap(markers=(marker,), gates=())

    made = feed(*(dict(gate_map=gate_map(float(k))) for k in range(25)))
    assert [each["t"] for each in made["maps"]] == pytest.approx([0.0, 1.0, 2.0], abs=0.05)


def _seen(time):
    corners = np.array([[400.0, 300], [500, 300], [500, 400], [400, 400]])
    return Detections(time, (Detection(4, corners, RigidTransform([0, 0, 10.0]), 0.1),))


def _moment(info, taken, detected):
    return dict(
        camera_view=CameraView.of(PICTURE),
        camera_image_time=[taken],
        camera_info=info,
        detections=_seen(detected),
    )


def test_it_is_the_very_picture_that_the_detector_is_given(feed, info):
    (told,) = feed(_moment(info, 0.0, 0.0), keep=True, camera=True)["pictures"]
    jpeg = np.frombuffer(base64.b64decode(told["jpeg"]), np.uint8)
    small = cv2.resize(PICTURE, (320, 180), interpolation=cv2.INTER_AREA)
    shown = cv2.imdecode(jpeg, cv2.IMREAD_GRAYSCALE)
    assert np.abs(shown.astype(int) - small).mean() < 12.0
    (marker,) = told["markers"]
    # Straight ahead of the camera is along x of a drone that looks that way.
    assert marker["id"] == 4 and marker["p"] == pytest.approx([10, 0, 3], abs=0.5)


def test_markers_of_another_picture_are_not_framed(feed, info):
    (told,) = feed(_moment(info, 0.0, -1 / 30), keep=True, camera=True)["pictures"]
    assert told["markers"] == []


def test_pictures_are_for_somebody(feed, info):
    moments = [_moment(info, 0.1 * k, 0.1 * k) for k in range(20)]
    assert feed(*moments, camera=True)["pictures"] == []
    assert len(feed(*moments, camera=True, keep=True)["pictures"]) == 5


def test_there_are_more_for_who_watches(feed, info):
    moments = [_moment(info, 0.1 * k, 0.1 * k) for k in range(9)]
    assert len(feed(*moments, camera=True, watching=True)["pictures"]) == 5


@pytest.mark.parametrize("k1", [0.0, -0.2])
def test_markers_are_framed_where_the_camera_took_them(info, k1):
    """Through a lens that distorts, too."""
    info = make_camera_info(
        width=1280, height=720, fov_y=1.0, X_BC=info.X_BC, D=[k1, 0.0, 0.0, 0.0, 0.0]
    )
    (told,) = marker_data(_seen(0.0), info, RigidTransform())
    corners = raw_pixels(_seen(0.0).markers[0].corners, info)
    np.testing.assert_allclose(
        np.reshape(told["corners"], (4, 2)) * [1280, 720] - 0.5, corners, atol=0.1
    )
    assert (k1 == 0.0) == np.allclose(corners[0], [400, 300])


def test_an_estimate_is_told_with_its_ellipsoid(feed):
    covariance = np.diag([*[1e-6] * 3, 0.01, 0.04, 0.09, *[0.1] * 9])
    estimate = np.concatenate([[0.0], STATE])
    estimate[5:8] += [0.3, 0.0, 0.4]
    slam = SlamState(belief=Belief(np.zeros(17), np.zeros((0, 5)), covariance))
    told = feed(dict(filtered_estimate=estimate, slam_state=slam), vio=True)["estimates"]
    assert told[0]["offset"] == [0.3, 0.0, 0.4]
    assert sorted(told[0]["radii"]) == pytest.approx([0.3, 0.6, 0.9])
    assert told[0]["sigma"] == 0.3


def test_before_anything_is_known_there_is_no_estimate_to_tell(feed):
    estimate = np.concatenate([[0.0], STATE])
    told = feed(dict(filtered_estimate=estimate, slam_state=SlamState()), vio=True)
    assert "estimates" not in told


@given(arrays(float, (3, 3), elements=st.floats(-2.0, 2.0)))
def test_the_ellipsoid_is_that_of_the_covariance(root):
    covariance = root @ root.T + 1e-3 * np.eye(3)
    data = estimate_data(np.zeros(9), covariance)
    R = Rotation.from_quat(data["axes"]).as_matrix()
    again = R @ np.diag((np.array(data["radii"]) / 3.0) ** 2) @ R.T
    np.testing.assert_allclose(again, covariance, atol=2e-3 * np.trace(covariance))
