"""When an estimate is of no use any more."""

import dataclasses as dc

import numpy as np
import pytest

from airrace.systems.estimation.kalman_update import Belief
from airrace.systems.estimation.landmarks import Landmark
from airrace.systems.estimation.lost_estimate import drift_sigma, why_lost
from airrace.systems.estimation.slam_state import SlamState
from tests.systems.estimation.motions import navigation

GOOD = np.diag([*[1e-4] * 3, *[0.04] * 3, *[0.01] * 3, *[1e-6] * 6, *[0.04] * 3, 1e-4, 1e-4])


def make_state(covariance=GOOD, **fields):
    belief = Belief(navigation(time=20.0), np.zeros((1, 5)), covariance)
    landmarks = (Landmark(0, seen_at=12.0),)
    return dc.replace(
        SlamState(), belief=belief, landmarks=landmarks, at_rest=False, image_time=20.0, **fields
    )


def with_variance(index, variance):
    covariance = GOOD.copy()
    covariance[index, index] = variance
    return covariance


def test_a_good_estimate_has_no_fault():
    assert why_lost(make_state(), 0.01) == ""


@pytest.mark.parametrize(
    ("state", "silence", "fault"),
    [
        (make_state(), 0.3, "the IMU fell silent"),
        (make_state(GOOD * np.nan), 0.0, "the estimate is not finite"),
        (make_state(refused_in_a_row=90), 0.0, "no marker was where it should be in 90 pictures"),
        (
            make_state(with_variance(4, 36.0)),
            0.0,
            "position uncertain by 6.0 m after 8.0 s without a marker",
        ),
        (
            make_state(with_variance(8, 9.0)),
            0.0,
            "velocity uncertain by 3.0 m/s after 8.0 s without a marker",
        ),
        (
            make_state(with_variance(1, 0.1)),
            0.0,
            "attitude uncertain by 18 degrees after 8.0 s without a marker",
        ),
        (dc.replace(SlamState(), at_rest=False), 0.0, "the attitude was not known at take-off"),
    ],
)
def test_every_fault_is_said_in_words(state, silence, fault):
    assert why_lost(state, silence) == fault
    assert why_lost(dc.replace(state, at_rest=True), silence) == ""


def test_a_map_that_is_off_as_a_whole_is_no_fault():
    """Drone and gate may be anywhere, as long as they are there together."""
    covariance = GOOD.copy()
    for i in range(3):
        for a in (3 + i, 15 + i):
            for b in (3 + i, 15 + i):
                covariance[a, b] += 100.0
    assert drift_sigma(make_state(covariance).belief) == pytest.approx(np.sqrt(0.08))
    assert why_lost(make_state(covariance), 0.0) == ""
