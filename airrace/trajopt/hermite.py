"""Hermite interpolation: polynomials from the derivatives at both ends."""

import functools
from fractions import Fraction
from math import comb, factorial, perm

import numpy as np


@functools.cache
def unit_segment(degree: int, minimized_derivative: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns what end derivatives make of a segment of unit duration.

    The interpolant of n derivatives x_k at 0 and y_k at 1 is
    sum_k x_k b_k(t) + y_k (-1)^k b_k(1 - t), where
    b_k(t) = t^k / k! (1 - t)^n sum_{s < n - k} C(n + s - 1, s) t^s.

    Args: degree: 2n - 1. minimized_derivative: whose squared integral is the cost, 4 for snap.

    Returns:
        (basis, hessian), each (2n, 2n), from (x_0 ..., y_0 ...): to monomial
        coefficients, and of the cost.
    """
    n, r = (degree + 1) // 2, minimized_derivative
    t, u = (np.polynomial.Polynomial(c) for c in ([0.0, 1.0], [1.0, -1.0]))
    # In rational numbers: rounding would cost the Hessian its null space.
    basis = np.array(
        [
            [
                Fraction(int(c), factorial(k))
                for c in (a**k * b**n * sum(comb(n + s - 1, s) * c**s for s in range(n - k))).coef
            ]
            for a, b, c in ((t, u, t), (-u, t, u))
            for k in range(n)
        ]
    ).T
    cost = np.array(
        [
            [Fraction(perm(i, r) * perm(j, r), max(i + j - 2 * r, 0) + 1) for j in range(2 * n)]
            for i in range(2 * n)
        ]
    )
    return basis.astype(float), (basis.T @ cost @ basis).astype(float)
