"""Linear algebra for matrices of a few rows, for compiled functions.

Matrices are float64 arrays in C order. On so few numbers this is faster than LAPACK, and
its last digits, unlike those of LAPACK and BLAS, do not depend on the processor.
"""

import math

import numpy as np

from airrace.common.jit import compiled


@compiled
def product(A, B):
    """Returns A B, (n, m), of matrices (n, k) and (k, m)."""
    result = np.zeros((len(A), B.shape[1]))
    for i in range(len(A)):
        for k in range(len(B)):
            for j in range(B.shape[1]):
                result[i, j] += A[i, k] * B[k, j]
    return result


@compiled
def cholesky(A):
    """Returns L with L L^T = A, lower triangular, (n, n).

    Args:
        A: symmetric and positive definite, (n, n); if it is not, L has NaN.
    """
    n = len(A)
    L = np.zeros((n, n))
    for j in range(n):
        for i in range(j, n):
            rest = A[i, j]
            for k in range(j):
                rest -= L[i, k] * L[j, k]
            L[i, j] = math.sqrt(rest) if i == j else rest / L[j, j]
    return L


@compiled
def solve_cholesky(L, b):
    """Returns x with L L^T x = b, (n,).

    Args:
        L: see cholesky().
        b: (n,).
    """
    n = len(L)
    x = np.empty(n)
    for i in range(n):
        rest = b[i]
        for k in range(i):
            rest -= L[i, k] * x[k]
        x[i] = rest / L[i, i]
    for i in range(n - 1, -1, -1):
        rest = x[i]
        for k in range(i + 1, n):
            rest -= L[k, i] * x[k]
        x[i] = rest / L[i, i]
    return x


@compiled
def inverse(A):
    """Returns the inverse of a symmetric positive definite matrix, (n, n); see cholesky()."""
    n = len(A)
    L = cholesky(A)
    result, unit = np.empty((n, n)), np.zeros(n)
    for j in range(n):
        unit[j] = 1.0
        column = solve_cholesky(L, unit)
        unit[j] = 0.0
        for i in range(j, n):
            result[i, j] = result[j, i] = column[i]
    return result
