import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RotationMatrix

from airrace.scenario import PerceptionConfig
from airrace.systems.mapping.image_mapper import ImageMapper, MapperState
from airrace.systems.mapping.original_estimator import (
    EMPTY,
    OriginalEstimator,
    estimate_position,
    make_gate,
)
from airrace.systems.types import Detection, Detections
from airrace.track import load_track
from airrace.track.map_files import statistics_data
from airrace.vehicle.camera_info import make_camera_info

TRACK = load_track("student-airrace")
INFO = make_camera_info(width=1280, height=720, fov_y=1.0, X_BC=RigidTransform())
# The camera looks along the world's z, from below; markers face it.
X_WC = RigidTransform([0.0, 0.0, -20.0])
FACING = RotationMatrix(np.diag([1.0, -1.0, -1.0]))
NORMAL = np.array([-1.0, 0.0, 0.0])

# Coordinates of which many are alike and some far off, in centimetres.
coordinates = st.one_of(st.integers(-20, 20), st.integers(-5000, 5000)).map(lambda x: x / 100)
positions = st.lists(st.tuples(*[coordinates] * 3), min_size=1, max_size=60)


def moments(values):
    """Mean and population variance of each coordinate of triples, term by term."""
    means, variances = [], []
    for axis in range(3):
        column = [value[axis] for value in values]
        mean = sum(column) / len(column)
        means.append(mean)
        variances.append(sum((x - mean) ** 2 for x in column) / len(column))
    return means, variances


def section_iii(values):
    """Mean, variance and number of outliers by section III of the paper, in plain loops."""
    means, variances = moments(values)
    kept = []
    for value in values:
        is_outlier = False
        for axis in range(3):
            off = abs(value[axis] - means[axis])
            if len(values) >= 2 and off > 0.0 and off >= 3.0 * math.sqrt(variances[axis]):
                is_outlier = True
        if not is_outlier:
            kept.append(value)
    return *moments(kept), len(values) - len(kept)


def is_borderline(values):
    """Whether rounding decides what an outlier is: something is exactly 3 s off."""
    means, variances = moments(values)
    return any(
        abs(abs(value[axis] - means[axis]) - 3.0 * math.sqrt(variances[axis])) < 1e-9
        for axis in range(3)
        if len({value[axis] for value in values}) > 1
        for value in values
    )


def estimated(values, outlier_sigma=3.0):
    return estimate_position(np.array(values, float), outlier_sigma)


def agrees(estimate, expected):
    means, variances, outliers = expected
    np.testing.assert_allclose(estimate.mean, means, atol=1e-9)
    np.testing.assert_allclose(estimate.variance, variances, atol=1e-9)
    assert estimate.outliers == outliers


def sightings():
    """IDs and positions in the order in which they are seen.

    Four markers with noise and outliers, of which 7 moves by 1.5 m in the end; and among them
    IDs out of range and, of marker 4, a position of (0, 0, 0) exactly.
    """
    rng = np.random.default_rng(7)
    truth = {0: [20.0, 5.0, 6.25], 2: [20.0, -5.0, 6.25], 4: [40.0, 5.0, 6.25], 7: [48.0, 0.0, 6.0]}
    seen = []
    for k in range(150):
        id = int(rng.choice(list(truth)))
        error = rng.normal(0.0, 0.2, 3)
        if k % 23 == 20:
            error[rng.integers(3)] += rng.choice([-6.0, 6.0])
        if id == 7 and k > 80:
            error[0] += 1.5
        seen.append((id, np.array(truth[id]) + error))
        if k % 31 == 5:
            seen.append((int(rng.choice([40, 500, 1023, -1])), np.array([1.0, 2.0, 3.0])))
        if k == 60:
            seen.append((4, np.zeros(3)))
    return seen


def test_section_iii_to_the_letter():
    """All figures after every single detection, against plain loops over all values so far."""
    config = PerceptionConfig(
        map_estimator="original", max_gates=10, max_range=math.inf, min_observations=1
    )
    mapper, state, values, wrong, invalid = ImageMapper(config), MapperState(), {}, 0, 0
    outliers_then = []
    for k, (id, p_WM) in enumerate(sightings(), 1):
        X_CM = X_WC.inverse() @ RigidTransform(FACING, p_WM)
        marker = Detection(id, np.zeros((4, 2)), X_CM, 0.0)
        state = mapper.updated(state, Detections(k / 30, (marker,)), X_WC, INFO)
        if not 0 <= id < 40:
            wrong += 1
        elif not p_WM.any():
            invalid += 1
        else:
            values.setdefault(id, []).append((X_WC @ X_CM.translation()).tolist())
        data = statistics_data(state.gate_map)
        expected = {id: section_iii(values[id]) for id in sorted(values)}
        assert (data["detections"], data["out_of_range_ids"]) == (k, wrong)
        assert data["error_rate_percent"] == pytest.approx(100 * wrong / k)
        assert data["outliers"] == sum(outliers for *_, outliers in expected.values())
        for marker, entry in zip(state.gate_map.markers, data["markers"], strict=True):
            means, variances, outliers = expected[marker.id]
            np.testing.assert_allclose(marker.p_WM, means, atol=1e-9)
            np.testing.assert_allclose(marker.variance, variances, atol=1e-9)
            np.testing.assert_allclose(entry["mean"], means, atol=1e-4)
            np.testing.assert_allclose(entry["variance"], variances, atol=1e-6)
            count = len(values[marker.id])
            assert (entry["id"], entry["detections"]) == (marker.id, count)
            assert (entry["observations"], entry["outliers"]) == (count - outliers, outliers)
        front = {0, 2} <= set(values)
        assert [gate.number for gate in state.gate_map.gates] == ([0] if front else [])
        outliers_then.append(data["outliers"])
    assert wrong == 5 and invalid == 1 and len(values) == 4
    assert data["refused"] == {
        "at the origin of the world": 1,
        "far from the map": data["outliers"],
        "foreign ID": 5,
    }
    # The sightings are of some use: outliers were found, and one of them counts again.
    assert outliers_then[-1] >= 4
    assert any(b < a for a, b in zip(outliers_then, outliers_then[1:]))


@given(positions)
def test_any_positions_as_in_plain_loops(values):
    assume(not is_borderline(values))
    agrees(estimated(values), section_iii(values))


@given(positions, st.randoms(use_true_random=False))
def test_the_order_of_detections_does_not_matter(values, random):
    assume(not is_borderline(values))

    def after(values):
        statistics = EMPTY
        for value in values:
            statistics = statistics.updated(np.array(value), NORMAL, 3.0)
        return statistics

    shuffled = random.sample(values, len(values))
    one, other = after(values), after(shuffled)
    assert (one.count, one.invalid) == (other.count, other.invalid)
    np.testing.assert_allclose(one.normal, other.normal)
    agrees(one.estimate, other.estimate)


def test_none_is_deleted():
    """One that is left out is tested again, and counts as soon as it is not alone."""
    near, far = (20.0, 5.0, 6.0), (30.0, 5.0, 6.0)
    agrees(estimated([*20 * [near], far]), ([20.0, 5.0, 6.0], [0.0, 0.0, 0.0], 1))
    agrees(estimated([*20 * [near], *3 * [far]]), moments([*20 * [near], *3 * [far]]) + (0,))


def test_the_first_outlier_is_one_of_ten():
    """Fewer values are at most sqrt(n - 1) < 3 standard deviations off, however far."""
    for n in range(1, 10):
        assert estimated([*(n - 1) * [(0.0, 0.0, 1.0)], (1e3, 0.0, 1.0)]).outliers == 0
    assert estimated([*10 * [(0.0, 0.0, 1.0)], (1e-3, 0.0, 1.0)]).outliers == 1


@pytest.mark.parametrize("n", [1, 2, 3, 50])
@pytest.mark.parametrize("sigma", [0.1, 1.0, 3.0])
def test_equal_values_are_no_outliers(n, sigma):
    """Their standard deviation is 0, or what rounding leaves of it."""
    estimate = estimated(n * [(0.1, -7.3, 1e5)], sigma)
    np.testing.assert_allclose(estimate.mean, [0.1, -7.3, 1e5])
    np.testing.assert_allclose(estimate.variance, 0.0, atol=1e-18)
    assert estimate.outliers == 0


@given(positions, st.floats(1e-3, 10.0))
def test_any_threshold_gives_a_finite_answer(values, sigma):
    """Even one that calls all values outliers."""
    estimate = estimated(values, sigma)
    assert np.isfinite([estimate.mean, estimate.variance]).all()
    assert 0 <= estimate.outliers < len(values)


def test_all_that_is_known_is_read_only():
    before = EMPTY.updated(np.ones(3), NORMAL, 3.0)
    after = before.updated(2 * np.ones(3), NORMAL, 3.0)
    assert (before.count, after.count) == (1, 2)
    np.testing.assert_array_equal(before.estimate.mean, np.ones(3))
    for array in (after.positions, after.normal, after.estimate.mean, after.estimate.variance):
        assert not array.flags.writeable


def test_a_marker_that_was_only_seen_invalid_is_not_in_the_map():
    statistics = {4: EMPTY.updated(np.zeros(3), NORMAL, 3.0)}
    gate_map = OriginalEstimator(outlier_sigma=3.0, min_observations=1).make_map(statistics)
    assert gate_map.markers == () and gate_map.refused == {"at the origin of the world": 1}


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
