import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.track.start import Start, pad_rotation, start_pose


def start(tilt_deg, direction_deg=0.0, heading_deg=30.0):
    return Start([3.0, 4.0, 0.0], heading_deg, tilt_deg, direction_deg)


@given(st.floats(0, 15), st.floats(-360, 360))
def test_the_pad_descends_in_its_direction(tilt_deg, direction_deg):
    R = pad_rotation(start(tilt_deg, direction_deg))
    normal = R.matrix()[:, 2]
    assert normal[2] == pytest.approx(np.cos(np.deg2rad(tilt_deg)))
    downhill = np.array([np.cos(np.deg2rad(direction_deg)), np.sin(np.deg2rad(direction_deg)), 0])
    slope = R.matrix() @ downhill
    np.testing.assert_allclose(slope[2], -np.sin(np.deg2rad(tilt_deg)), atol=1e-12)
    np.testing.assert_allclose(normal[:2], np.sin(np.deg2rad(tilt_deg)) * downhill[:2], atol=1e-12)


def test_a_level_start_stands_on_the_ground():
    X_WB = start_pose(start(0.0), 0.4, 0.1)
    np.testing.assert_allclose(X_WB.translation(), [3.0, 4.0, 0.1])
    R = X_WB.rotation().matrix()
    np.testing.assert_allclose(R[:, 0], [np.cos(np.pi / 6), 0.5, 0.0], atol=1e-12)


def test_the_drone_stands_on_the_middle_of_the_slope():
    """The normal through the drone's origin meets the slope at its middle."""
    place = start(10.0, 40.0)
    X_WB = start_pose(place, 0.4, 0.1)
    foot = X_WB.translation() - 0.1 * X_WB.rotation().col(2)
    np.testing.assert_allclose(foot[:2], place.position[:2])
    assert foot[2] == pytest.approx(0.02 + 0.6 * np.sin(np.deg2rad(10.0)))
