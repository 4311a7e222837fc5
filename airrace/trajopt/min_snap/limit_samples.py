"""How near a minimum-snap trajectory is to its limits at samples, with exact gradients."""

from math import perm

import numpy as np

from airrace.common.jit import compiled
from airrace.math.small_matrices import cholesky, solve_cholesky
from airrace.trajopt.min_snap.limit_excess import assembled, equations
from airrace.trajopt.min_snap.problem import unit_segment


class LimitSamples:
    """|v|^2 / v_max^2 and |a|^2 / a_max^2 at samples, by the durations, in machine code.

    The trajectory is that of solve_min_snap(); see LimitExcess. For the free derivatives
    x, H x + g = 0, hence dx = -H^-1 (dH x + dg).

    Attributes:
        maps: from derivatives at a segment's ends, times duration^order, to its samples of
            velocity and acceleration, times duration and its square, as shares of the
            limits, (2, samples, 2n).
    """

    def __init__(self, problem, limits, samples: int):
        """Args: problem: MinSnapProblem. limits: of v and a. samples: a segment."""
        p = problem
        basis, unit_hessian = unit_segment(p.degree, p.minimized_derivative)
        fractions, powers = np.linspace(0, 1, samples), range(len(basis))
        self.maps = np.array(
            [
                np.array([[perm(j, k) * t ** max(j - k, 0) for j in powers] for t in fractions])
                @ basis
                / limits[k - 1]
                for k in (1, 2)
            ]
        )
        self._arguments = (
            p.values.T.copy(),
            p.fixed.T.copy(),
            p.rows,
            p.order,
            unit_hessian,
            p.offset,
            1 - 2 * p.minimized_derivative,
        )

    def __call__(self, durations):
        """Returns the samples, (count,), and their Jacobian, (count, segments).

        Args:
            durations: of the segments (s).

        Returns:
            two arrays with NaN if the durations are too unlike each other.
        """
        return _samples(np.array(durations, float), self.maps, *self._arguments)

    def ends(self, durations):
        """Returns the derivatives at the ends of segments, (segments, 2n, d)."""
        return _ends(np.array(durations, float), *self._arguments)[0]


@compiled
def _samples(durations, maps, values, fixed, rows, order, unit_hessian, offset, power):
    """See LimitSamples.__call__(); the rest as _excess() of limit_excess.py has it."""
    ends, by_time = _ends(durations, values, fixed, rows, order, unit_hessian, offset, power)
    (count, width, d), samples = ends.shape, maps.shape[1]
    result = np.zeros((2, count, samples))
    jacobian = np.zeros((2, count, samples, count))
    row, change = np.empty(width), np.empty(count)
    for k in range(2):
        for s in range(count):
            scales = durations[s] ** (order - (k + 1.0))
            for i in range(samples):
                for j in range(width):
                    row[j] = maps[k, i, j] * scales[j]
                for m in range(d):
                    x = 0.0
                    change[:] = 0.0
                    for j in range(width):
                        x += row[j] * ends[s, j, m]
                        change[s] += row[j] * (order[j] - k - 1) / durations[s] * ends[s, j, m]
                        for r in range(count):
                            change[r] += row[j] * by_time[s, j, m, r]
                    result[k, s, i] += x * x
                    for r in range(count):
                        jacobian[k, s, i, r] += 2.0 * x * change[r]
    return result.ravel(), jacobian.reshape(-1, count)


@compiled
def _ends(durations, values, fixed, rows, order, unit_hessian, offset, power):
    """Returns the ends of segments, (segments, 2n, d), and their Jacobian by the durations."""
    (d, size), (count, width) = values.shape, rows.shape
    segments, hessian, scale = assembled(durations, size, rows, order, unit_hessian, power)
    ends = np.empty((count, width, d))
    by_time = np.zeros((count, width, d, count))
    for m in range(d):
        free, matrix, linear = equations(
            values[m], fixed[m], hessian, scale, segments[-1], rows[-1], offset[m]
        )
        factor = cholesky(matrix)
        solved = values[m].copy()
        solved[free] = scale[free] * solve_cholesky(factor, linear)
        for s in range(count):
            ends[s, :, m] = solved[rows[s]]
        ends[-1, width // 2, m] += offset[m]
        for s in range(count):
            change = np.zeros(size)
            for i in range(width):
                for j in range(width):
                    change[rows[s, i]] -= (
                        segments[s, i, j]
                        * (power + order[i] + order[j])
                        / durations[s]
                        * ends[s, j, m]
                    )
            moved = np.zeros(size)
            moved[free] = scale[free] * solve_cholesky(factor, scale[free] * change[free])
            for r in range(count):
                by_time[r, :, m, s] = moved[rows[r]]
    return ends, by_time
