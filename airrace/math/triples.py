"""Vectors as tuples of three numbers, for compiled functions that run millions of times a second.

They do what vec3.py and quaternion.py do for arrays. A new array takes memory from the heap, which
costs more than all the arithmetic on its three numbers; a tuple stays in the processor's registers.
A matrix is a tuple of its rows. Sums have a fixed order, as in vec3.py. Arguments may be arrays.
"""

import math

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
def scaled(factor: float, a: Triple) -> Triple:
    """Returns factor a."""
    return (factor * a[0], factor * a[1], factor * a[2])


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
    """Returns q + factor N(q) w_W, where N(q) w_W is the derivative of q; see integrate()."""
    w, x, y, z = q
    b, c, d = 0.5 * factor * w_W[0], 0.5 * factor * w_W[1], 0.5 * factor * w_W[2]
    return (
        w - b * x - c * y - d * z,
        x + b * w + c * z - d * y,
        y + c * w + d * x - b * z,
        z + d * w + b * y - c * x,
    )


@compilable
def quaternion_product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Returns the quaternion of R(a) R(b)."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@compilable
def exp_quaternion(vector: Triple) -> Quaternion:
    """Returns the unit quaternion of a rotation vector (rad); Sola 2017, eq. 101."""
    x, y, z = vector
    half = 0.5 * math.sqrt(x * x + y * y + z * z)
    s = 0.5 * (math.sin(half) / half if half > 1e-8 else 1.0)
    return (math.cos(half), s * x, s * y, s * z)


@compilable
def normalized(q: Quaternion) -> Quaternion:
    """Returns a quaternion made one long."""
    w, x, y, z = q
    length = math.sqrt(w * w + x * x + y * y + z * z)
    return (w / length, x / length, y / length, z / length)


@compilable
def integrate(q: Quaternion, w_W: Triple, dt: float) -> Quaternion:
    """Returns the unit quaternion of R_WB after a short time at constant angular velocity.

    It is the product of [1, w dt / 2] and q, normalised: exact to second order.

    Args: q: [w, x, y, z] before, of any length. w_W: in the world (rad/s). dt: any sign (s).
    """
    return normalized(quaternion_added(q, dt, w_W))


@compilable
def turned(q: Quaternion, vector: Triple) -> Quaternion:
    """Returns the unit quaternion of R exp(vector): a rotation in axes of the body (rad)."""
    return normalized(quaternion_product(q, exp_quaternion(vector)))


@compilable
def rotation_between(q_1: Quaternion, q_2: Quaternion) -> Triple:
    """Returns the rotation vector of R_1^T R_2 (rad), no longer than pi.

    It is twice the angle of the quaternion conj(q_1) q_2, along its axis (Sola, "Quaternion
    kinematics for the error-state Kalman filter", 2017, equation 105).

    Args: q_1, q_2: of R_1 and R_2, of any length.
    """
    a, b, c, d = q_1
    w, x, y, z = q_2
    v = (
        a * x - b * w - c * z + d * y,
        a * y + b * z - c * w - d * x,
        a * z - b * y + c * x - d * w,
    )
    real = a * w + b * x + c * y + d * z
    if real < 0.0:  # q and -q are the same rotation
        real, v = -real, (-v[0], -v[1], -v[2])
    length = math.sqrt(dot(v, v))
    if length < 1e-12 * real:  # the angle is the sine
        return scaled(2.0 / real, v)
    return scaled(2.0 * math.atan2(length, real) / length, v)
