import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from airrace.systems.perception.corner_refit import refit
from tests.systems.perception.marker_pictures import picture, pose, project
from tests.worlds.cases import first

angles = st.floats(-0.78, 0.78)
poses = st.builds(
    pose,
    st.floats(-4, 4),
    st.floats(-2, 2),
    st.floats(10, 32),
    st.floats(-0.3, 0.3),
    angles,
    st.floats(-3, 3),
)


def rough(corners, seed=0):
    """Corners as OpenCV finds them: within the square, and off by half a pixel."""
    inwards = corners.mean(axis=0) - corners
    inwards /= np.linalg.norm(inwards, axis=1)[:, None]
    return corners + 0.7 * inwards + np.random.default_rng(seed).uniform(-0.5, 0.5, (4, 2))


def draw_marker(rng, distance):
    """Returns an ID and X_CM of a marker at a distance (m), turned by up to 0.6 rad."""
    X_CM = pose(
        *rng.uniform(-2.5, 2.5, 2), distance, *rng.uniform(-0.6, 0.6, 2), rng.uniform(-3, 3)
    )
    return int(rng.integers(80)), X_CM


@pytest.mark.slow
@settings(max_examples=15)
@given(poses, st.integers(0, 79))
def test_exact_in_sharp_pictures(X_CM, id):
    corners = project(X_CM)
    found, _ = refit(picture({id: X_CM}), [rough(corners)])
    # Edges along rows of pixels are the worst case.
    np.testing.assert_allclose(found[0], corners, atol=0.3)


@pytest.mark.slow
@settings(max_examples=15)
@given(poses, st.integers(0, 79), st.floats(0.4, 0.8), st.floats(0, 3))
def test_close_in_blurred_and_noisy_pictures(X_CM, id, blur, noise):
    corners = project(X_CM)
    found, covariance = refit(picture({id: X_CM}, blur, noise), [rough(corners)])
    np.testing.assert_allclose(found[0], corners, atol=0.35)
    assert np.allclose(covariance[0], covariance[0].T)
    assert np.linalg.eigvalsh(covariance[0]).min() > 0


@pytest.mark.slow
@pytest.mark.parametrize("distance", first([22.0, 12.0, 30.0]))
@pytest.mark.parametrize("blur", [0.0, 0.8])
def test_unbiased_and_as_sure_as_it_says(distance, blur):
    rng = np.random.default_rng(4)
    radial, errors, misfits = [], [], []
    for k in range(25):
        id, X_CM = draw_marker(rng, distance)
        corners = project(X_CM)
        image = picture({id: X_CM}, blur, 3.0, seed=k)
        found, covariance = refit(image, [rough(corners, k)])
        error = found[0] - corners
        outwards = corners - corners.mean(axis=0)
        outwards /= np.linalg.norm(outwards, axis=1)[:, None]
        radial.append(np.sum(error * outwards, axis=1).mean())
        errors.append(error)
        misfits.append(error.ravel() @ np.linalg.solve(covariance[0], error.ravel()) / 8)
    assert abs(np.mean(radial)) < 0.02
    assert np.sqrt(2 * np.mean(np.square(errors))) < 0.08
    assert 1 / 6 < np.mean(misfits) < 3


@pytest.mark.slow
def test_small_squares_in_sharp_pictures():
    # The model that mends blurred edges would turn these, which need no mending.
    rng, squares = np.random.default_rng(5), []
    for k in range(50):
        id, X_CM = draw_marker(rng, 45.0)
        image = picture({id: X_CM}, noise=2.0, seed=k)
        error = refit(image, [rough(project(X_CM), k)])[0][0] - project(X_CM)
        squares.append((error**2).sum(axis=1).mean())
    assert np.sqrt(np.mean(squares)) < 0.05


def test_many_at_once_are_as_good_as_one_by_one():
    X_CMs = {1: pose(-2, 0, 9), 6: pose(2, 0, 15, yaw=0.5), 30: pose(0, 1, 30)}
    image = picture(X_CMs)
    quads = [rough(project(X_CM)) for X_CM in X_CMs.values()]
    together = refit(image, quads)
    for i, quad in enumerate(quads):
        for all, alone in zip(together, refit(image, [quad])):
            np.testing.assert_allclose(all[i], alone[0], atol=1e-4)


def test_nothing_to_refit():
    corners, covariance = refit(np.zeros((720, 1280), np.uint8), np.zeros((0, 4, 2)))
    assert corners.shape == (0, 4, 2) and covariance.shape == (0, 8, 8)


@pytest.mark.parametrize("grey", [0, 255])
def test_no_corners_where_nothing_is(grey):
    quads = [project(pose(0, 0, 10)), project(pose(9.5, 5.2, 15))]  # the second one at the rim
    corners, _ = refit(np.full((720, 1280), grey, np.uint8), quads)
    assert np.isnan(corners).all()
