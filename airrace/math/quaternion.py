"""Quaternions of rotations, [w, x, y, z] as Drake has them, for compiled functions.

The functions are those of triples.py, but return arrays.
"""

import numpy as np

from airrace.math import triples
from airrace.math.vec3 import array_of

# The rotation matrix, (3, 3), of a quaternion of any length, (4,).
rotation_matrix = array_of(triples.rotation_rows)
# The rotation vector of R_1^T R_2 (rad), (3,), of two quaternions of any length.
rotation_between = array_of(triples.rotation_between)
# The unit quaternion of R_WB after a short time at a constant angular velocity.
integrate = array_of(triples.integrate)
# The quaternion of R(a) R(b), (4,).
quaternion_product = array_of(triples.quaternion_product)
# The unit quaternion of a rotation vector (rad), (4,).
exp_quaternion = array_of(triples.exp_quaternion)
# The unit quaternion of R exp(vector), (4,).
turned = array_of(triples.turned)


def heading(q: np.ndarray) -> float:
    """Returns the angle from the world's x axis to the body's, seen from above (rad).

    Args: q: of R_WB, of any length, (4,).
    """
    w, x, y, z = q
    return float(np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z))


def reference_yaw(q: np.ndarray) -> float:
    """Returns the yaw that an attitude has as a reference or a set-point (rad).

    Controllers make y of the body normal to z and to the horizontal direction of the yaw, see
    attitude_from_force(). So the yaw is that of y less a quarter turn; the direction of x seen from
    above, heading(), is another one once the drone leans to a side, and as a set-point would turn
    the drone on and on.

    Args: q: of R_WB, of any length, (4,).
    """
    w, x, y, z = q
    return float(np.arctan2(2 * (w * z - x * y), w * w - x * x + y * y - z * z))
