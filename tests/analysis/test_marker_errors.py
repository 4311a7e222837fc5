import dataclasses as dc

import numpy as np
import pytest
from pydrake.math import RigidTransform

from airrace.analysis.marker_errors import marker_errors, true_corners
from airrace.systems.types import Detection
from tests.systems.perception.marker_pictures import INFO, pose, project

X_WC = RigidTransform([1.0, -2.0, 3.0])
X_CM = pose(1.0, -0.5, 14.0, yaw=0.3)
EXACT = Detection(id=0, corners=true_corners(X_CM, INFO), X_CM=X_CM, reprojection_error=0.0)


def errors(detection):
    return marker_errors(detection, X_WC, X_WC @ X_CM, INFO)


def test_the_true_corners_are_those_that_pictures_are_drawn_with():
    np.testing.assert_allclose(true_corners(X_CM, INFO), project(X_CM), atol=1e-9)


def test_an_exact_detection_has_no_errors():
    assert errors(EXACT) == pytest.approx((0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize("pull", [-0.5, 0.25])
def test_pull_is_how_far_corners_lie_outside(pull):
    outwards = EXACT.corners - EXACT.corners.mean(axis=0)
    lengths = np.linalg.norm(outwards, axis=1, keepdims=True)
    moved = dc.replace(EXACT, corners=EXACT.corners + pull * outwards / lengths)
    assert errors(moved).pull == pytest.approx(pull)


def test_a_shift_of_all_corners_is_no_pull():
    # Of a square that is seen from the front: its corners lie opposite each other.
    X_CM = pose(0.0, 0.0, 14.0)
    exact = Detection(0, true_corners(X_CM, INFO), X_CM, 0.0)
    shifted = dc.replace(exact, corners=exact.corners + [0.3, -0.2])
    assert marker_errors(shifted, X_WC, X_WC @ X_CM, INFO).pull == pytest.approx(0.0, abs=1e-9)


def test_distance_is_positive_for_a_marker_that_was_measured_too_far():
    far = dc.replace(EXACT, X_CM=RigidTransform(X_CM.rotation(), 1.1 * X_CM.translation()))
    assert errors(far).distance == pytest.approx(0.1 * np.linalg.norm(X_CM.translation()))
