"""Vectors as triples of numbers: in a control loop, faster than arrays so small.

Components may also be arrays of samples: a triple of arrays is many vectors.
Compiled functions may call all of this.
"""

from airrace.common.jit import compilable


@compilable
def dot(a, b):
    """Returns a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compilable
def cross(a, b):
    """Returns a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@compilable
def sum2(p, a, q, b):
    """Returns p a + q b."""
    return (p * a[0] + q * b[0], p * a[1] + q * b[1], p * a[2] + q * b[2])


@compilable
def sum3(p, a, q, b, r, c):
    """Returns p a + q b + r c."""
    return (
        p * a[0] + q * b[0] + r * c[0],
        p * a[1] + q * b[1] + r * c[1],
        p * a[2] + q * b[2] + r * c[2],
    )


@compilable
def columns(w, x, y, z):
    """Returns the columns of the rotation matrix of a quaternion of any length."""
    s = 2.0 / (w * w + x * x + y * y + z * z)
    return (
        (1 - s * (y * y + z * z), s * (x * y + w * z), s * (x * z - w * y)),
        (s * (x * y - w * z), 1 - s * (x * x + z * z), s * (y * z + w * x)),
        (s * (x * z + w * y), s * (y * z - w * x), 1 - s * (x * x + y * y)),
    )


@compilable
def triple(array, start):
    """Returns three numbers of an array from an index on."""
    return array[start], array[start + 1], array[start + 2]


@compilable
def in_axes(v, axes):
    """Returns the components of v along three axes."""
    return dot(v, axes[0]), dot(v, axes[1]), dot(v, axes[2])


@compilable
def transposed(M):
    """Returns the columns of three rows."""
    return ((M[0][0], M[1][0], M[2][0]), (M[0][1], M[1][1], M[2][1]), (M[0][2], M[1][2], M[2][2]))
