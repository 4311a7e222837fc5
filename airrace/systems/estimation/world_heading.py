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

where w^T e is the error of the drone's heading, by w = R^T e_z and the theta of e: G takes a turn
of the world before the update to the same turn after it. In an invariant filter (Barrau and
Bonnabel, "An EKF-SLAM algorithm with consistency properties", 2015) the choice of the errors does
that.
"""

import numpy as np

from airrace.common.jit import compilable
from airrace.math.quaternion import rotation_matrix
from airrace.math.small_matrices import mirrored
from airrace.math.vec3 import cross, dot
from airrace.systems.estimation.error_state import AT, DRONE
from airrace.systems.estimation.gate_projection import GATE
from airrace.systems.estimation.navigation import Navigation
from airrace.systems.mapping.gate_filter import AT_GATE, as_gate

E_Z = np.array((0.0, 0.0, 1.0))


@compilable
def turn_of_the_world(state: Navigation, gates: np.ndarray) -> np.ndarray:
    """Returns n, (15 + 5 k,): the errors that a turn of the world by 1 rad makes.

    Args: state: of the drone. gates: nominal states of k gates, (k, 5).
    """
    n = np.zeros(DRONE + GATE * len(gates))
    n[AT.theta] = rotation_matrix(state.quaternion)[2]
    n[AT.position], n[AT.velocity] = cross(E_Z, state.position), cross(E_Z, state.velocity)
    for gate, of_gate in zip(gates, n[DRONE:].reshape(gates.shape)):
        of_gate[AT_GATE.p_WG] = cross(E_Z, as_gate(gate).p_WG)
        of_gate[AT_GATE.heading] = 1.0
    return n


@compilable
def carried_covariance(P: np.ndarray, change: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Returns the covariance G P G^T, (15 + 5 k, 15 + 5 k).

    Args: P: before. change: n+ - n, (15 + 5 k,). w: R^T e_z before, (3,).
    """
    Pw = dot(P.T, w)
    variance = dot(w, Pw)
    return mirrored(
        P + np.outer(change, Pw) + np.outer(Pw, change) + np.outer(variance * change, change)
    )
