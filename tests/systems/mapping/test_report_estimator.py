import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.systems.mapping.observation import Observation
from airrace.systems.mapping.report_estimator import EMPTY, ReportEstimator, make_gate
from airrace.track import load_track

TRACK = load_track("student-airrace")

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


def test_nothing_is_an_outlier_before_enough_observations():
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
    gate_map = ReportEstimator(outlier_sigma=3.0, min_observations=1).make_map(
        {0: EMPTY.updated(np.ones(3), np.ones(3), 3.0, 5)}, time=0.0, detections=1, out_of_range=0
    )
    with pytest.raises(ValueError):
        gate_map.markers[0].p_WM[0] = 2.0


@given(st.lists(st.tuples(*[st.floats(-0.2, 0.2)] * 3), min_size=1, max_size=40), st.data())
def test_section_iii_to_the_letter(errors, data):
    """Against the mean and the standard deviation of all that counts, computed anew each time."""
    estimator = ReportEstimator(outlier_sigma=3.0, min_observations=5)
    statistics, counted, outliers = {}, [], 0
    for k, error in enumerate(errors):
        far = data.draw(st.booleans())
        p = np.array([20.0, 5, 6]) + error + [3.0 * far, 0, 0]
        observation = Observation(
            id=4,
            time=k / 30,
            p_WC=np.zeros(3),
            p_WM=p,
            covariance=np.eye(3),
            normal=np.array([-1.0, 0, 0]),
            heading_variance=1.0,
        )
        statistics = estimator.updated(statistics, observation)
        if len(counted) >= 5 and np.any(
            np.abs(p - np.mean(counted, axis=0)) > 3 * np.std(counted, axis=0, ddof=1) + 1e-9
        ):
            outliers += 1
        else:
            counted.append(p)
    gate_map = estimator.make_map(
        statistics, time=1.0, detections=len(errors), out_of_range=0, refused={}
    )
    (marker,) = gate_map.markers
    assert (marker.count, marker.outliers) == (len(counted), outliers)
    np.testing.assert_allclose(marker.p_WM, np.mean(counted, axis=0), atol=1e-9)
    assert gate_map.refused == ({"far from the map": outliers} if outliers else {})
