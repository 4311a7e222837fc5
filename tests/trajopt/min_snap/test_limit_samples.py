"""The samples are those of the trajectory itself, and their gradient that of differences."""

import numpy as np
import pytest

from airrace.trajopt.min_snap.limit_samples import LimitSamples
from airrace.trajopt.min_snap.min_snap import DerivativeConstraint, solve_min_snap
from airrace.trajopt.min_snap.problem import MinSnapProblem

NAN = np.nan


@pytest.mark.parametrize("constrained", [False, True])
@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("degree, order", [(9, 4), (7, 3)])
def test_limit_samples_and_their_gradient(constrained, periodic, degree, order):
    rng = np.random.default_rng(0)
    waypoints = rng.normal(scale=20.0, size=(6, 3))
    options = dict(degree=degree, minimized_derivative=order, periodic=periodic)
    if periodic:
        options["period_offset"] = [100.0, 20.0, 3.0]
    if constrained:
        options["constraints"] = [
            DerivativeConstraint(1, 2, [0.0, 3.0, NAN]),
            DerivativeConstraint(2, 1, [NAN, 5.0, 1.0]),
        ]
    durations = rng.uniform(1, 4, len(waypoints) - (not periodic))
    samples = LimitSamples(MinSnapProblem.build(waypoints, **options), (20.0, 10.0), 5)
    values, jacobian = samples(durations)
    p = solve_min_snap(waypoints, durations, **options)
    times = np.array(p.get_segment_times())[:-1, None] + durations[:, None] * np.linspace(0, 1, 5)
    expected = [
        np.sum(p.derivative(k).vector_values(times.ravel()) ** 2, axis=0) / limit**2
        for k, limit in ((1, 20.0), (2, 10.0))
    ]
    np.testing.assert_allclose(values, np.concatenate(expected), rtol=1e-7, atol=1e-9)
    h = 1e-4
    numeric = np.column_stack(
        [
            (samples(durations + h * e)[0] - samples(durations - h * e)[0]) / (2 * h)
            for e in np.eye(len(durations))
        ]
    )
    np.testing.assert_allclose(jacobian, numeric, rtol=1e-5, atol=1e-6 * np.abs(jacobian).max())
