import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator

from airrace.scenario import MAP_ESTIMATORS, PerceptionConfig
from airrace.systems.mapping.gate_mapper import GateMapper, extrapolate
from airrace.systems.types import Detection, Detections
from airrace.track import load_track
from airrace.vehicle import CameraMount
from airrace.vehicle.camera_info import make_camera_info

TRACK = load_track("student-airrace")
CAMERA = CameraMount(position=[0.1, 0.0, 0.0])
INFO = make_camera_info(width=1280, height=720, fov_y=1.0, X_BC=CAMERA.X_BC)
LATENCY = 0.01


def estimate(time, p, yaw=0.0, v=(0, 0, 0), w=(0, 0, 0)):
    q = RollPitchYaw(0.1, -0.2, yaw).ToQuaternion().wxyz()
    return np.array([time, *q, *p, *w, *v], float)


def sight(X_WB, board, time):
    X_CM = (X_WB @ INFO.X_BC).inverse() @ board.X_WM
    return Detection(board.id, np.zeros((4, 2)), X_CM, 0.0)


def run(images, seconds, pose=lambda t: estimate(t, [0, 0, 5]), seen=lambda t: None, **perception):
    """Shows a mapper images {time: markers(X_WB)} and returns its map.

    As in flight: estimates come at 200 Hz, an image's detections a latency
    after its exposure. What is `seen` of a time replaces the estimate; `perception` are
    fields of PerceptionConfig.
    """
    mapper = GateMapper(
        fps=30.0,
        latency=LATENCY,
        state_rate=200.0,
        config=PerceptionConfig(**{"max_range": 1e3} | perception),
    )
    simulator = Simulator(mapper)
    context = simulator.get_mutable_context()
    mapper.GetInputPort("camera_info").FixValue(context, Value[object](INFO))
    detections = Detections()
    for k in range(round(1000 * seconds)):
        t = k / 1000
        if k % 5 == 0:
            mapper.GetInputPort("filtered_estimate").FixValue(
                context, pose(t) if seen(t) is None else seen(t)
            )
        for time, markers in images.items():
            if abs(time - t) < 5e-4:
                detections = Detections(time, tuple(markers(extrapolate(pose(time), 0.0))))
        mapper.GetInputPort("detections").FixValue(context, Value[object](detections))
        simulator.AdvanceTo(t + 0.0005)
    return mapper.get_output_port().Eval(context)


@pytest.mark.slow
@pytest.mark.parametrize("map_estimator", MAP_ESTIMATORS)
def test_projects_through_the_pose_at_the_images_own_time(map_estimator):
    """At 10 m/s and 2 rad/s, a pose 10 ms off would be 10 cm and more off."""

    def pose(t):
        return estimate(t, [10 * t, 0, 5], yaw=2 * t, v=(10, 0, 0), w=(0, 0, 2))

    board = TRACK.boards()[0]
    # Estimates come every 5 ms, these images in between.
    times = [k / 30 for k in range(1, 30)]
    images = {t: lambda X_WB: [sight(X_WB, board, 0)] for t in times}
    gate_map = run(images, 1.1, pose, map_estimator=map_estimator)
    (marker,) = gate_map.markers
    assert marker.count == 29
    np.testing.assert_allclose(marker.p_WM, board.X_WM.translation(), atol=0.005)
    np.testing.assert_allclose(marker.normal, board.X_WM.rotation().col(2), atol=0.005)


@pytest.mark.parametrize("map_estimator", MAP_ESTIMATORS)
def test_counters_and_ranges(map_estimator):
    boards = TRACK.boards()
    stray = [Detection(id, np.zeros((4, 2)), RigidTransform([0, 0, 5.0]), 0.0) for id in (80, 1023)]
    images = {
        time: lambda X_WB: [sight(X_WB, boards[0], 0), sight(X_WB, boards[4], 0), *stray]
        for time in (0.1, 0.2)
    }
    gate_map = run(images, 0.3, max_range=30.0, map_estimator=map_estimator)
    assert [m.id for m in gate_map.markers] == [0]  # board 4 is far away
    assert gate_map.detections == 8
    assert gate_map.out_of_range == 4
    assert gate_map.error_rate == 0.5
    assert gate_map.refused == {"foreign ID": 4, "beyond the range": 2}
    assert gate_map.gates == ()


def test_an_image_counts_once():
    images = {t: lambda X_WB: [sight(X_WB, TRACK.boards()[0], 0)] for t in (0.1, 0.2)}
    (marker,) = run(images, 1.0).markers
    assert marker.count == 2


@pytest.mark.parametrize("map_estimator", MAP_ESTIMATORS)
def test_gates_appear_with_enough_observations(map_estimator):
    boards = TRACK.boards()
    images = {
        k / 30: lambda X_WB: [sight(X_WB, boards[4], 0), sight(X_WB, boards[6], 0)]
        for k in range(1, 5)
    }

    def pose(t):
        return estimate(t, [25, -3, 5])

    assert run(images, 0.5, pose, map_estimator=map_estimator).gates == ()
    images[5 / 30] = images[1 / 30]
    (gate,) = run(images, 0.5, pose, map_estimator=map_estimator).gates
    truth = TRACK.gates[1]
    assert gate.number == 1
    np.testing.assert_allclose(gate.p_WG, truth.p_WG, atol=1e-6)
    np.testing.assert_allclose(gate.forward, truth.forward, atol=1e-6)
    np.testing.assert_allclose(gate.pylons, [truth.p_WL[:2], truth.p_WR[:2]], atol=1e-6)


@given(st.floats(0, 0.01), st.floats(-3, 3), st.floats(-3, 3))
def test_extrapolate(dt, rate, yaw):
    later = extrapolate(estimate(0, [1, 2, 3], yaw, v=(4, 5, 6), w=(0, 0, rate)), dt)
    now = extrapolate(estimate(0, [1, 2, 3], yaw), 0.0)
    np.testing.assert_allclose(later.translation(), [1 + 4 * dt, 2 + 5 * dt, 3 + 6 * dt])
    turned = RollPitchYaw(0, 0, rate * dt).ToRotationMatrix() @ now.rotation()
    np.testing.assert_allclose(later.rotation().matrix(), turned.matrix(), atol=1e-5)


BOARD = TRACK.boards()[0]


def looks(times):
    return {t: lambda X_WB: [sight(X_WB, BOARD, 0)] for t in times}


@pytest.mark.parametrize(
    "broken",
    [
        np.full(14, np.nan),
        np.zeros(14),
        np.r_[np.inf, estimate(0, [0, 0, 5])[1:]],
        np.r_[0.105, np.zeros(4), estimate(0, [0, 0, 5])[5:]],
    ],
)
def test_broken_poses_do_no_harm(broken):
    gate_map = run(looks([0.05, 0.1, 0.15]), 0.3, seen=lambda t: broken if t > 0.08 else None)
    assert gate_map.detections == 3
    assert gate_map.refused == {"no pose of the drone at that time": 2, "not yet confirmed": 1}
    back = run(looks([0.05, 0.1, 0.15]), 0.3, seen=lambda t: broken if 0.08 < t < 0.12 else None)
    (marker,) = back.markers
    assert marker.count == 2
    np.testing.assert_allclose(marker.p_WM, BOARD.X_WM.translation(), atol=1e-6)


def jumping(t):
    """The drone's pose, which is 2 m higher at one time."""
    return estimate(t, [0, 0, 5 + 2.0 * (abs(t - 0.1) < 1e-3)])


@pytest.mark.parametrize("map_estimator", MAP_ESTIMATORS)
def test_a_drone_that_jumps_maps_nothing_from_mid_air(map_estimator):
    gate_map = run(looks([0.05, 0.1, 0.15]), 0.3, seen=jumping, map_estimator=map_estimator)
    assert gate_map.refused == {"pose jumps": 1}
    assert gate_map.markers[0].count == 2


def test_it_does_without_the_jump_filter():
    gate_map = run(
        looks([0.05, 0.1, 0.15]), 0.3, seen=jumping, map_estimator="original", jump_filter=False
    )
    (marker,) = gate_map.markers
    assert gate_map.refused == {} and marker.count == 3
    assert marker.p_WM[2] == pytest.approx(BOARD.X_WM.translation()[2] + 2.0 / 3, abs=1e-6)


@pytest.mark.parametrize("map_estimator", MAP_ESTIMATORS)
def test_a_gate_far_away_that_was_seen_once_or_twice(map_estimator):
    """Twice by the robust estimator, which wants two observations in agreement."""
    boards, images = TRACK.boards(), 1 if map_estimator == "original" else 2
    settings = dict(max_range=np.inf, min_observations=1, map_estimator=map_estimator)

    def pose(t):
        return estimate(t, [-40, -5, 5])

    far = {
        k / 30: lambda X_WB: [sight(X_WB, boards[id], 0) for id in (0, 2)]
        for k in range(1, images + 1)
    }
    assert run(far, 0.3, pose, **settings | {"max_range": 30.0}).gates == ()
    one = {1 / 30: lambda X_WB: [sight(X_WB, boards[0], 0)]}
    assert run(one, 0.3, pose, **settings).gates == ()
    gate_map = run(far, 0.3, pose, **settings)
    assert gate_map.refused == {}
    if map_estimator == "original":
        (gate,) = gate_map.gates
        np.testing.assert_allclose(gate.p_WG, TRACK.gates[0].p_WG, atol=1e-6)
    else:  # from so far away, two are not enough for it to be certain
        assert [m.count for m in gate_map.markers] == [2, 2]


def test_times_that_cannot_be():
    """NaN, the future, and before the first estimate: counted, and the next image is mapped."""
    mapper = GateMapper(
        fps=30.0, latency=LATENCY, state_rate=200.0, config=PerceptionConfig(max_range=1e3)
    )
    simulator = Simulator(mapper)
    context = simulator.get_mutable_context()
    mapper.GetInputPort("camera_info").FixValue(context, Value[object](INFO))
    marker = sight(extrapolate(estimate(0, [0, 0, 5]), 0.0), BOARD, 0)
    for k, time in enumerate((0.0, np.nan, 1e9, np.inf, None, None), 1):
        t = LATENCY + k / 30
        mapper.GetInputPort("filtered_estimate").FixValue(context, estimate(t - 0.001, [0, 0, 5]))
        mapper.GetInputPort("detections").FixValue(
            context, Value[object](Detections(t - 0.001 if time is None else time, (marker,)))
        )
        simulator.AdvanceTo(t + 0.001)
    gate_map = mapper.get_output_port().Eval(context)
    assert gate_map.detections == 6
    assert gate_map.refused == {"no pose of the drone at that time": 4}
    assert gate_map.markers[0].count == 2
    assert gate_map.time == pytest.approx(LATENCY + 6 / 30 - 0.001)
