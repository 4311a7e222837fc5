"""What no picture and no IMU can tell: the heading of the world.

Turn drone and gates together about the vertical, and nothing that is measured changes. To first
order, such a turn changes the errors of a belief (see error_state.py) along a direction

    n = (R^T e_z,  e_z x p,  e_z x v,  0,  0;  e_z x p_1,  1,  0;  e_z x p_2,  1,  0; ...),

with the positions p_k of the gates. It depends on the nominal state, which an update changes. Kept
as it is, the covariance then takes the old direction for one that has been measured: the filter
believes to learn its heading from pictures, and becomes too certain of it (Huang, Mourikis and
Roumeliotis, "Observability-based rules for designing consistent EKF SLAM estimators", 2010). So an
update carries errors over, by

    G = I + (n+ - n) w^T,   w^T n = 1,

where w^T e is the error of the drone's heading: G takes a turn of the world before the update to
the same turn after it. In an invariant filter (Barrau and Bonnabel, "An EKF-SLAM algorithm with
consistency properties", 2015) the choice of the errors does that.
"""

import numpy as np

from airrace.common.jit import compilable
from airrace.math.quaternion import rotation_matrix
from airrace.systems.estimation.error_state import DRONE, POSITION, THETA, VELOCITY
from airrace.systems.estimation.gate_projection import GATE
from airrace.systems.estimation.navigation import Navigation


@compilable
def heading_gradient(state: Navigation) -> np.ndarray:
    """Returns w = R^T e_z, (3,): the error of the heading is w^T theta."""
    R = rotation_matrix(state.quaternion)
    return np.array((R[2, 0], R[2, 1], R[2, 2]))


@compilable
def turn_of_the_world(state: Navigation, gates: np.ndarray) -> np.ndarray:
    """Returns n, (15 + 5 k,): the errors that a turn of the world by 1 rad makes.

    Args:
        state: of the drone.
        gates: nominal states of k gates, (k, 5).
    """
    n = np.zeros(DRONE + GATE * len(gates))
    n[THETA : THETA + 3] = heading_gradient(state)
    n[POSITION], n[POSITION + 1] = -state.position[1], state.position[0]
    n[VELOCITY], n[VELOCITY + 1] = -state.velocity[1], state.velocity[0]
    for k in range(len(gates)):
        at = DRONE + GATE * k
        n[at], n[at + 1], n[at + 3] = -gates[k, 1], gates[k, 0], 1.0
    return n


@compilable
def carry_over(columns: np.ndarray, change: np.ndarray, w: np.ndarray) -> None:
    """Multiplies columns of errors, (15 + 5 k, m), by G from the left, in place.

    Args:
        columns: to be changed.
        change: n+ - n, (15 + 5 k,).
        w: see heading_gradient(), before, (3,).
    """
    for j in range(columns.shape[1]):
        turn = w[0] * columns[0, j] + w[1] * columns[1, j] + w[2] * columns[2, j]
        for i in range(len(columns)):
            columns[i, j] += change[i] * turn


@compilable
def carry_covariance_over(P: np.ndarray, change: np.ndarray, w: np.ndarray) -> None:
    """Changes a covariance P to G P G^T, in place; see carry_over()."""
    n = len(P)
    Pw = np.empty(n)  # P w
    for i in range(n):
        Pw[i] = P[i, 0] * w[0] + P[i, 1] * w[1] + P[i, 2] * w[2]
    variance = w[0] * Pw[0] + w[1] * Pw[1] + w[2] * Pw[2]
    for i in range(n):
        for j in range(i + 1):
            value = P[i, j] + change[i] * Pw[j] + Pw[i] * change[j]
            P[i, j] = P[j, i] = value + variance * change[i] * change[j]
