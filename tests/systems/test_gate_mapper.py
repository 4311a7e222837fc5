import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator

from airrace.systems.gate_mapper import GateMapper, extrapolate
from airrace.systems.marker_statistics import MarkerStatistics, make_gate, make_map
from airrace.systems.types import Detection, Detections, make_camera_info
from airrace.track import load_track
from airrace.vehicle import CameraMount

TRACK = load_track("student-airrace")
CAMERA = CameraMount(position=[0.1, 0.0, 0.0])
INFO = make_camera_info(width=1280, height=720, fov_y=1.0, X_BC=CAMERA.X_BC)
EMPTY = MarkerStatistics(0, 0, np.zeros(3), np.zeros(3), np.zeros(3))
LATENCY = 0.01


def estimate(time, p, yaw=0.0, v=(0, 0, 0), w=(0, 0, 0)):
    q = RollPitchYaw(0.1, -0.2, yaw).ToQuaternion().wxyz()
    return np.array([time, *q, *p, *w, *v], float)


def sight(X_WB, board, time):
    X_CM = (X_WB @ INFO.X_BC).inverse() @ board.X_WM
    return Detection(board.id, np.zeros((4, 2)), X_CM, 0.0)


def run(images, seconds, pose=lambda t: estimate(t, [0, 0, 5]), max_range=1e3):
    """Shows a mapper images {time: markers(X_WB)} and returns its map.

    As in flight: estimates come at 200 Hz, an image's detections a latency
    after its exposure.
    """
    mapper = GateMapper(
        fps=30.0, latency=LATENCY, state_rate=200.0, max_range=max_range, max_gates=20,
        outlier_sigma=3.0, min_sightings=5,
    )
    simulator = Simulator(mapper)
    context = simulator.get_mutable_context()
    mapper.GetInputPort("camera_info").FixValue(context, Value[object](INFO))
    detections = Detections()
    for k in range(round(1000 * seconds)):
        t = k / 1000
        if k % 5 == 0:
            mapper.GetInputPort("state_estimate").FixValue(context, pose(t))
        for time, markers in images.items():
            if abs(time - t) < 5e-4:
                detections = Detections(time, tuple(markers(extrapolate(pose(time), 0.0))))
        mapper.GetInputPort("detections").FixValue(context, Value[object](detections))
        simulator.AdvanceTo(t + 0.0005)
    return mapper.get_output_port().Eval(context)


def test_projects_through_the_pose_at_the_images_own_time():
    """At 10 m/s and 2 rad/s, a pose 10 ms off would be 10 cm and more off."""

    def pose(t):
        return estimate(t, [10 * t, 0, 5], yaw=2 * t, v=(10, 0, 0), w=(0, 0, 2))

    board = TRACK.boards()[0]
    # Estimates come every 5 ms, these images in between.
    times = [k / 30 for k in range(1, 30)]
    images = {t: lambda X_WB: [sight(X_WB, board, 0)] for t in times}
    gate_map = run(images, 1.1, pose)
    (marker,) = gate_map.markers
    assert marker.count == 29
    np.testing.assert_allclose(marker.p_WM, board.X_WM.translation(), atol=0.005)
    np.testing.assert_allclose(marker.normal, board.X_WM.rotation().col(2), atol=0.005)


def test_counters_and_ranges():
    boards = TRACK.boards()
    stray = [Detection(id, np.zeros((4, 2)), RigidTransform([0, 0, 5.0]), 0.0) for id in (80, 1023)]
    images = {
        0.1: lambda X_WB: [sight(X_WB, boards[0], 0), sight(X_WB, boards[34], 0), *stray]
    }
    gate_map = run(images, 0.3, max_range=30.0)
    assert [m.id for m in gate_map.markers] == [0]  # board 34 is far away
    assert gate_map.detections == 4
    assert gate_map.out_of_range == 2
    assert gate_map.error_rate == 0.5
    assert gate_map.gates == ()


def test_an_image_counts_once():
    images = {0.1: lambda X_WB: [sight(X_WB, TRACK.boards()[0], 0)]}
    (marker,) = run(images, 1.0).markers
    assert marker.count == 1


def test_gates_appear_with_enough_sightings():
    boards = TRACK.boards()
    images = {
        k / 30: lambda X_WB: [sight(X_WB, boards[4], 0), sight(X_WB, boards[6], 0)]
        for k in range(1, 5)
    }
    assert run(images, 0.5).gates == ()
    images[5 / 30] = images[1 / 30]
    (gate,) = run(images, 0.5).gates
    truth = TRACK.gates[1]
    assert gate.number == 1
    np.testing.assert_allclose(gate.p_WG, truth.p_WG, atol=1e-6)
    np.testing.assert_allclose(gate.forward, truth.forward, atol=1e-6)
    np.testing.assert_allclose(gate.pylons, [truth.p_WL[:2], truth.p_WR[:2]], atol=1e-6)


points = st.lists(st.tuples(*[st.floats(-50, 50)] * 3), min_size=2, max_size=30)


@given(points)
def test_mean_and_variance_of_what_counts(samples):
    statistics = EMPTY
    for p in samples:
        statistics = statistics.updated(np.array(p), np.array([1.0, 0, 0]), 3.0, 100)
    assert statistics.count == len(samples)
    np.testing.assert_allclose(statistics.mean, np.mean(samples, axis=0), atol=1e-9)
    np.testing.assert_allclose(statistics.variance, np.var(samples, axis=0, ddof=1), atol=1e-6)


def test_three_sigma_rejection():
    rng = np.random.default_rng(1)
    statistics = EMPTY
    for p in rng.normal([1, 2, 3], 0.1, (50, 3)):
        statistics = statistics.updated(p, np.zeros(3), 3.0, 5)
    outliers = statistics.outliers
    for axis in range(3):
        p = np.array([1.0, 2.0, 3.0])
        p[axis] += 5 * np.sqrt(statistics.variance[axis])
        after = statistics.updated(p, np.zeros(3), 3.0, 5)
        assert after.outliers == outliers + 1
        assert after.count == statistics.count
        np.testing.assert_array_equal(after.mean, statistics.mean)


def test_nothing_is_an_outlier_before_enough_sightings():
    statistics = EMPTY
    for x in (0.0, 0.0, 0.0, 0.0, 100.0):
        statistics = statistics.updated(np.array([x, 0, 0]), np.zeros(3), 3.0, 5)
    assert statistics.count == 5 and statistics.outliers == 0


@given(st.integers(0, 9), st.floats(-0.5, 0.5))
def test_make_gate_of_every_gate(n, shift):
    truth = TRACK.gates[n]
    boards = {b.id: b.X_WM.translation() + shift for b in truth.boards(n)}
    gate = make_gate(n, boards[4 * n], boards[4 * n + 2])
    np.testing.assert_allclose(gate.p_WG, truth.p_WG + shift, atol=1e-9)
    assert np.cos(gate.heading - truth.heading) == pytest.approx(1.0)
    assert gate.spacing == pytest.approx(10.0)


def test_two_boards_in_one_place_are_no_gate():
    assert make_gate(0, np.zeros(3), np.array([0.5, 0, 0])) is None


def test_the_map_is_read_only():
    gate_map = make_map(
        {0: EMPTY.updated(np.ones(3), np.ones(3), 3.0, 5)}, min_sightings=1, time=0.0,
        detections=1, out_of_range=0,
    )
    with pytest.raises(ValueError):
        gate_map.markers[0].p_WM[0] = 2.0


@given(st.floats(0, 0.01), st.floats(-3, 3), st.floats(-3, 3))
def test_extrapolate(dt, rate, yaw):
    later = extrapolate(estimate(0, [1, 2, 3], yaw, v=(4, 5, 6), w=(0, 0, rate)), dt)
    now = extrapolate(estimate(0, [1, 2, 3], yaw), 0.0)
    np.testing.assert_allclose(later.translation(), [1 + 4 * dt, 2 + 5 * dt, 3 + 6 * dt])
    turned = RollPitchYaw(0, 0, rate * dt).ToRotationMatrix() @ now.rotation()
    np.testing.assert_allclose(later.rotation().matrix(), turned.matrix(), atol=1e-5)
