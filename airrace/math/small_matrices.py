"""Linear algebra for matrices of a few rows, for compiled functions.

Matrices are float64 arrays in C order. On so few numbers this is faster than LAPACK, and
its last digits, unlike those of LAPACK and BLAS, do not depend on the processor.
"""

import math

import numpy as np

from airrace.common.jit import compiled


@compiled
def product(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Returns A B, (n, m), of matrices (n, k) and (k, m). Zeros in A take next to no time."""
    result = np.zeros((len(A), B.shape[1]))
    for i in range(len(A)):
        for k in range(len(B)):
            factor = A[i, k]
            if factor != 0.0:
                for j in range(B.shape[1]):
                    result[i, j] += factor * B[k, j]
    return result


@compiled
def propagated(J: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Returns the covariance J C J^T, (n, n), of J x, if C is that of x, (k, k); J: (n, k)."""
    return product(product(J, covariance), J.T)


@compiled
def affine(A: np.ndarray, x: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns A x + b, (n,), of a matrix (n, k) and vectors (k,) and (n,); b comes first."""
    result = np.empty(len(A))
    for i in range(len(A)):
        total = b[i]
        for k in range(len(x)):
            total += A[i, k] * x[k]
        result[i] = total
    return result


@compiled
def apply(A: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Returns A x, (n,), of a matrix (n, k) and a vector (k,)."""
    return affine(A, x, np.zeros(len(A)))


@compiled
def reduced(P: np.ndarray, W: np.ndarray) -> np.ndarray:
    """Returns P - W W^T, (n, n), symmetric to the last digit; P: (n, n), W: (n, k)."""
    result = np.empty(P.shape)
    for i in range(len(P)):
        for j in range(i + 1):
            rest = P[i, j]
            for k in range(W.shape[1]):
                rest -= W[i, k] * W[j, k]
            result[i, j] = result[j, i] = rest
    return result


@compiled
def mirrored(A: np.ndarray) -> np.ndarray:
    """Returns the symmetric matrix whose lower triangle is that of A, (n, n)."""
    result = A.copy()
    for i in range(len(A)):
        for j in range(i):
            result[j, i] = A[i, j]
    return result


@compiled
def skew(v: np.ndarray) -> np.ndarray:
    """Returns [v]x, (3, 3), the matrix of the cross product with v: [v]x w is v x w."""
    x, y, z = v
    return np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))


@compiled
def cholesky(A: np.ndarray) -> np.ndarray:
    """Returns L with L L^T = A, lower triangular, (n, n); NaN unless A is positive definite."""
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
def solve_lower(L: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns L^-1 b of a lower triangular matrix (n, n), for one b, (n,), or m of them, (n, m)."""
    x = np.empty(b.shape)
    for i in range(len(L)):
        rest = b[i]
        for k in range(i):
            rest = rest - L[i, k] * x[k]
        x[i] = rest / L[i, i]
    return x


@compiled
def solve_upper(L: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns L^-T b, (n,), of a lower triangular matrix (n, n)."""
    x = np.empty(len(L))
    for i in range(len(L) - 1, -1, -1):
        rest = b[i]
        for k in range(i + 1, len(L)):
            rest -= L[k, i] * x[k]
        x[i] = rest / L[i, i]
    return x


@compiled
def solve_cholesky(L: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns x with L L^T x = b, (n,); L: see cholesky(); b: (n,)."""
    return solve_upper(L, solve_lower(L, b))


@compiled
def inverse(A: np.ndarray) -> np.ndarray:
    """Returns the inverse of a symmetric positive definite matrix, (n, n); see cholesky()."""
    n, L = len(A), cholesky(A)
    M = np.zeros((n, n))  # L^-1
    for j in range(n):
        M[j, j] = 1.0 / L[j, j]
        for i in range(j + 1, n):
            total = 0.0
            for k in range(j, i):
                total += L[i, k] * M[k, j]
            M[i, j] = -total / L[i, i]
    return product(M.T, M)
