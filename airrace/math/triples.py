"""Vectors as tuples of three numbers, for compiled functions that run millions of times a second.

They do what vec3.py does for arrays. A new array takes memory from the heap, which costs more
than all the arithmetic on its three numbers; a tuple stays in the processor's registers. A
matrix is a tuple of its rows. Sums have a fixed order, as in vec3.py.
"""

from airrace.common.jit import compilable

type Triple = tuple[float, float, float]
type Rows = tuple[Triple, Triple, Triple]
type Quaternion = tuple[float, float, float, float]


@compilable
def dot(a: Triple, b: Triple) -> float:
    """Returns a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compilable
def cross(a: Triple, b: Triple) -> Triple:
    """Returns a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@compilable
def times(a: Triple, b: Triple) -> Triple:
    """Returns the products of the elements."""
    return (a[0] * b[0], a[1] * b[1], a[2] * b[2])


@compilable
def difference(a: Triple, b: Triple) -> Triple:
    """Returns a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@compilable
def added(a: Triple, factor: float, b: Triple) -> Triple:
    """Returns a + factor b."""
    return (a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2])


@compilable
def rotate(R: Rows, v: Triple) -> Triple:
    """Returns R v."""
    return (dot(R[0], v), dot(R[1], v), dot(R[2], v))


@compilable
def rotate_back(R: Rows, v: Triple) -> Triple:
    """Returns R^T v."""
    return (
        R[0][0] * v[0] + R[1][0] * v[1] + R[2][0] * v[2],
        R[0][1] * v[0] + R[1][1] * v[1] + R[2][1] * v[2],
        R[0][2] * v[0] + R[1][2] * v[1] + R[2][2] * v[2],
    )


@compilable
def rotation_rows(q: Quaternion) -> Rows:
    """Returns the rotation matrix of a quaternion [w, x, y, z] of any length."""
    w, x, y, z = q
    s = 2.0 / (w * w + x * x + y * y + z * z)
    return (
        (1.0 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)),
        (s * (x * y + w * z), 1.0 - s * (x * x + z * z), s * (y * z - w * x)),
        (s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)),
    )


@compilable
def quaternion_added(q: Quaternion, factor: float, w_W: Triple) -> Quaternion:
    """Returns q + factor N(q) w_W, where N(q) w_W is the derivative of q, see quaternion.py.

    Args:
        q: of R_WB, [w, x, y, z], of any length.
        factor: a time (s).
        w_W: angular velocity in the world (rad/s).
    """
    w, x, y, z = q
    b, c, d = 0.5 * factor * w_W[0], 0.5 * factor * w_W[1], 0.5 * factor * w_W[2]
    return (
        w - b * x - c * y - d * z,
        x + b * w + c * z - d * y,
        y + c * w + d * x - b * z,
        z + d * w + b * y - c * x,
    )
