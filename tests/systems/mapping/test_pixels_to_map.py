"""Detector and mapper together: from rendered pixels to a gate in the map, by every setting."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix

from airrace.scenario import CORNERS, MAP_ESTIMATORS, POSES, PerceptionConfig
from airrace.systems.mapping.image_mapper import ImageMapper, MapperState
from airrace.systems.perception.aruco_detector import DetectorState, detect
from airrace.systems.perception.marker_measurement import DetectorConfig
from airrace.systems.perception.marker_search import MarkerSearch
from airrace.systems.sensing.camera_view import CameraView
from tests.systems.perception.marker_pictures import FACING, INFO, picture
from tests.worlds.cases import first

# The camera flies along the world's x towards a gate whose boards are at x = 0, and is turned
# a little, so that it does not see them head-on.
R_WC = RotationMatrix([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
TURN = 0.25  # rad
BOARDS = dict(zip((0, 2), ([0.0, 5.0, 6.25], [0.0, -5.0, 6.25])))


def approach(distances):
    """Yields pictures and poses X_WC of the camera, at distances (m) from the boards' plane."""
    R_WM = R_WC @ FACING
    for k, distance in enumerate(distances):
        turned = RotationMatrix.MakeZRotation(TURN) @ R_WC
        X_WC = RigidTransform(turned, [-distance, -0.1 * k - distance * TURN, 6.0])
        X_CW = X_WC.inverse()
        markers = {id: X_CW @ RigidTransform(R_WM, p_WM) for id, p_WM in BOARDS.items()}
        yield picture(markers, blur=0.6, noise=2.0, seed=k), X_WC


def mapped(distances, perception):
    """Returns the map of an approach."""
    config = DetectorConfig(
        corners=perception.corners, poses=perception.poses, jump_filter=perception.jump_filter
    )
    search = MarkerSearch(refine=perception.corners == "opencv")
    mapper, state, last = ImageMapper(perception), MapperState(), DetectorState()
    for k, (grey, X_WC) in enumerate(approach(distances)):
        last = detect(search, CameraView.of(grey), 0.2 * k, INFO, last, config)
        state = mapper.updated(state, last.detections, X_WC, INFO)
    return state.gate_map


def error(gate_map):
    return max(np.linalg.norm(m.p_WM - BOARDS[m.id]) for m in gate_map.markers if m.count)


@pytest.mark.slow
@pytest.mark.parametrize("map_estimator", MAP_ESTIMATORS)
@pytest.mark.parametrize("poses", first(POSES))
@pytest.mark.parametrize("corners", first(CORNERS))
def test_a_gate_is_mapped_by_any_corners_poses_and_estimator(corners, poses, map_estimator):
    perception = PerceptionConfig(corners=corners, poses=poses, map_estimator=map_estimator)
    gate_map = mapped(np.linspace(26.0, 14.0, 12), perception)
    assert [gate.number for gate in gate_map.gates] == [0]
    assert {m.id: m.count + m.outliers for m in gate_map.markers if m.count} == {0: 12, 2: 12}
    assert error(gate_map) < (0.05 if corners == "refit" else 0.4)


@pytest.mark.slow
def test_as_the_original_maps_from_its_first_picture():
    """No range gate, no warm-up: one picture from 33 m, and the gate is in the map."""
    original = PerceptionConfig(
        corners="opencv",
        poses="marker",
        jump_filter=False,
        max_range=np.inf,
        map_estimator="original",
        min_observations=1,
    )
    gate_map = mapped([33.0], original)
    assert len(gate_map.gates) == 1 and error(gate_map) < 2.0
    assert mapped([33.0], PerceptionConfig()).gates == ()
