import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from airrace.scenario import MAP_ESTIMATORS, PerceptionConfig
from airrace.systems.mapping.image_mapper import ImageMapper, MapperState
from airrace.systems.types import Detection, Detections
from airrace.track.map_files import map_data, statistics_data
from airrace.vehicle import CameraMount
from airrace.vehicle.camera_info import make_camera_info

INFO = make_camera_info(width=1280, height=720, fov_y=1.0, X_BC=CameraMount().X_BC)


def make_mapper(map_estimator, max_range=30.0):
    return ImageMapper(
        PerceptionConfig(max_gates=10, map_estimator=map_estimator, max_range=max_range)
    )


def fuzzed(rng) -> Detection:
    """A detection that is good, broken or nonsense."""
    R_CM = RotationMatrix(np.diag([1.0, -1.0, -1.0]))
    R_CM = RollPitchYaw(rng.normal(0, 0.7, 3)).ToRotationMatrix() @ R_CM
    p = rng.normal([0, 0, 15.0], [3, 1, 5])
    if rng.random() < 0.2:
        p[rng.integers(3)] = rng.choice([np.nan, np.inf, -np.inf, 0.0, 1e300, -1e300, 1e-300])
    covariance = [
        None,
        np.eye(6) * 10.0 ** rng.uniform(-30, 30),
        np.full((6, 6), np.nan),
        np.zeros((6, 6)),
        -np.eye(6),
        rng.normal(size=(6, 6)),
    ][rng.choice(6, p=[0.4, 0.4, 0.05, 0.05, 0.05, 0.05])]
    id = int(rng.integers(40))
    if rng.random() < 0.2:
        id = int(rng.choice([-1, 40, 1023, 2**40, -(2**40)]))
    return Detection(
        id,
        np.full((4, 2), np.nan),
        RigidTransform(R_CM, p),
        np.nan,
        covariance=covariance,
        joint=bool(rng.random() < 0.5),
        ambiguity=rng.random(),
    )


@pytest.mark.slow
@pytest.mark.parametrize("max_range", [30.0, np.inf])
@pytest.mark.parametrize("map_estimator", MAP_ESTIMATORS)
def test_two_thousand_fuzzed_detections(map_estimator, max_range):
    """Nothing crashes, everything is counted, and the map stays finite."""
    rng = np.random.default_rng(0)
    mapper, state, own, foreign = make_mapper(map_estimator, max_range), MapperState(), 0, 0
    for k in range(500):
        markers = tuple(fuzzed(rng) for _ in range(4))
        refused = (("tiny quad", 3), ("foreign ID", 99)) if k % 100 == 0 else ()
        own, foreign = own + len(refused), foreign + bool(refused)
        X_WC = None
        if rng.random() < 0.95:
            R = RollPitchYaw(rng.normal(0, 0.3, 3)).ToRotationMatrix() @ INFO.X_BC.rotation()
            X_WC = RigidTransform(R, rng.normal(0, 20, 3))
        state = mapper.updated(state, Detections(k / 30, markers, refused), X_WC, INFO)
    gate_map = state.gate_map
    assert gate_map.detections == 2000 + foreign
    counted = sum(m.count for m in gate_map.markers)
    assert counted + sum(gate_map.refused.values()) == 2000 + own
    assert gate_map.out_of_range == gate_map.refused["foreign ID"] > 300
    for marker in gate_map.markers:
        assert 0 <= marker.id < 40
        for values in (marker.p_WM, marker.variance, marker.normal):
            assert np.isfinite(values).all()
    for gate in gate_map.gates:
        assert np.isfinite([*gate.p_WG, gate.heading, gate.spacing]).all()
    assert map_data(gate_map) and statistics_data(gate_map)


@given(st.sampled_from(MAP_ESTIMATORS), st.lists(st.integers(0, 2**32), max_size=5))
def test_the_state_before_is_not_touched(map_estimator, seeds):
    mapper, states = make_mapper(map_estimator), [MapperState()]
    for k, seed in enumerate(seeds):
        markers = (fuzzed(np.random.default_rng(seed)),)
        states.append(
            mapper.updated(states[-1], Detections(float(k), markers), RigidTransform(), INFO)
        )
    assert [m.gate_map.detections for m in states] == list(range(len(seeds) + 1))


@pytest.mark.parametrize("map_estimator", MAP_ESTIMATORS)
def test_an_image_counts_once(map_estimator):
    mapper = make_mapper(map_estimator)
    marker = Detection(
        2,
        np.zeros((4, 2)),
        RigidTransform(RotationMatrix(np.diag([1.0, -1.0, -1.0])), [0, 0, 5.0]),
        0.0,
    )
    once = mapper.updated(
        MapperState(), Detections(1.0, (marker,), (("tiny quad", 4),)), RigidTransform(), INFO
    )
    assert once.gate_map.refused["tiny quad"] == 1
    for time in (1.0, 0.5):
        again = mapper.updated(once, Detections(time, (marker,)), RigidTransform(), INFO)
        assert again is once
    lost = mapper.updated(once, Detections(9.0, (marker,)), None, INFO, "no idea")
    assert lost.gate_map.time == 1.0 and lost.gate_map.refused["no idea"] == 1
    assert mapper.updated(lost, Detections(9.0, (marker,)), None, INFO) is lost
    assert mapper.updated(lost, Detections(2.0, (marker,)), RigidTransform(), INFO) is not lost
    assert mapper.updated(lost, Detections(9.0), None, INFO) is lost
