import pytest

from airrace.vehicle.sensor_failures import CameraFailure, ImuFailure, failure_at


@pytest.mark.parametrize(
    "time, kind",
    [
        (0.0, None),
        (0.9999, None),
        (1.0 - 1e-12, "lost"),
        (1.5, "lost"),
        (2.0 - 1e-12, "nan"),
        (2.4999, "nan"),
        (2.5, None),
        (7.0, "stuck"),
        (1e9, "stuck"),
    ],
)
def test_the_first_that_is_there_counts(time, kind):
    failures = [ImuFailure("lost", 1.0, 1.0), ImuFailure("nan", 1.2, 1.3), ImuFailure("stuck", 3.0)]
    assert failure_at(failures, time) == kind


def test_none():
    assert failure_at([], 1.0) is None
    assert failure_at([CameraFailure(time=2.0)], 2.0) == "dark"
