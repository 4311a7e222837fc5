"""The measurement update of the filter: what the corners of a gate's markers tell."""

import math
from typing import NamedTuple

import numpy as np

from airrace.common.jit import compilable, compiled
from airrace.math.angles import wrap_angle
from airrace.math.quaternion import rotation_between, rotation_matrix
from airrace.math.small_matrices import (
    affine,
    cholesky,
    mirrored,
    product,
    propagated,
    reduced,
    solve_lower,
    solve_upper,
)
from airrace.math.vec3 import cross, dot
from airrace.systems.estimation.error_state import (
    AT,
    DRONE,
    DroneError,
    corrected,
    drone_error_vector,
)
from airrace.systems.estimation.gate_projection import GATE, POSE, Camera, predicted_corners
from airrace.systems.estimation.navigation import Navigation, as_navigation, navigation_vector
from airrace.systems.estimation.world_heading import E_Z, carried_covariance, turn_of_the_world
from airrace.systems.mapping.gate_filter import AT_GATE, as_gate

# Errors that pictures share, and that their noise does not show: px, of a coordinate of a corner up
# to this depth (m); beyond, it grows. Without noise, and from the true pose, detected corners are
# 0.025 px off up to that depth. More than that, as one picture's error is much like the next one's.
CORNER_SIGMA, SHARP_RANGE = 0.04, 16.0
ACTIVE = POSE + GATE  # errors that one gate's picture depends on


class Belief(NamedTuple):
    """What the filter believes at one time."""

    navigation: np.ndarray  #: the drone's nominal state, a vector of Navigation, (17,)
    gates: np.ndarray  #: nominal states of n gates, (n, 5)
    covariance: np.ndarray  #: of the errors of drone and gates, (15 + 5 n, 15 + 5 n)


class GateMeasurement(NamedTuple):
    """Markers of one gate in one picture."""

    gate: int  #: index of the gate in the belief
    ids: np.ndarray  #: of the markers, (m,)
    corners: np.ndarray  #: (m, 8) px, x and y of each corner in turn
    #: Variance of a coordinate by the picture's noise, of each marker (px^2), (m,).
    noise: np.ndarray


class Innovation(NamedTuple):
    """How well markers fitted the belief before an update."""

    #: The normalised innovation squared, r^T S^-1 r, of the picture before the update.
    squared: float
    #: What the update minimised, at the last iteration: squared standard deviations of innovations
    #: and corrections; infinite if a corner would be behind the camera.
    cost: float


@compilable
def _corrected_gates(gates, error):
    """Returns the gates that nominal ones are, if those have an error, (15 + 5 k,)."""
    result = gates + error[DRONE:].reshape(gates.shape)
    result[:, AT_GATE.heading] = wrap_angle(result[:, AT_GATE.heading])
    return result


def error_between(state: Navigation, start: Navigation) -> np.ndarray:
    """Returns the error, (15,), that a start has if the truth is a state."""
    return drone_error_vector(
        DroneError(
            rotation_between(start.quaternion, state.quaternion),
            state.position - start.position,
            state.velocity - start.velocity,
            state.gyro_bias - start.gyro_bias,
            state.accel_bias - start.accel_bias,
        )
    )


@compilable
def _linearized(state, gate, measurement, camera):
    """Returns innovation, (8 m,), its matrix H, (8 m, 11), variances, (8 m,), and least depth."""
    n = measurement.corners.size
    residual, H, variances = np.empty(n), np.empty((n, ACTIVE)), np.empty(n)
    nearest = np.inf
    for m in range(len(measurement.ids)):
        pixels, by_pose, by_gate, depth = predicted_corners(state, gate, measurement.ids[m], camera)
        nearest = min(nearest, depth)
        sigma = CORNER_SIGMA * max(1.0, depth / SHARP_RANGE)
        rows = slice(8 * m, 8 * m + 8)
        residual[rows] = measurement.corners[m] - pixels
        variances[rows] = sigma * sigma + measurement.noise[m]
        H[rows, :POSE], H[rows, POSE:] = by_pose, by_gate
    return residual, H, variances, nearest


@compiled
def updated(
    belief: Belief, measurement: GateMeasurement, camera: Camera, inflation: float, iterations: int
) -> tuple[Belief, Innovation]:
    """Returns the belief after an update, and how well the markers fitted.

    An iterated Kalman update is Gauss-Newton on the squared standard deviations of innovation
    and correction (Bell and Cathey, 1993): with the correction e so far,

        e+ = K (z - h(x) + H e),   K = P H^T (H P H^T + R)^-1,   x+ = x + (e+ - e).

    At x+, errors and covariance are those of before, carried over so that the heading of the
    world remains unknown, see world_heading.py. In the end the covariance is P - K S K^T, as
    P - W W^T with W = P H^T L^-T and the Cholesky factor L of S, so that it is symmetric.

    Args:
        belief: before.
        measurement: the markers.
        camera: of the picture.
        inflation: of the corners' variances, at least 1.
        iterations: at least 1.
    """
    state, gates = as_navigation(belief.navigation.copy()), belief.gates.copy()
    P = belief.covariance.copy()
    columns = np.append(np.arange(POSE), DRONE + GATE * measurement.gate + np.arange(GATE))
    e = np.zeros((len(P), 1))
    PHt, L, squared, cost = np.zeros((len(P), 0)), np.zeros((0, 0)), 0.0, np.inf
    for iteration in range(iterations):
        innovation, H, variances, nearest = _linearized(
            state, gates[measurement.gate], measurement, camera
        )
        if not nearest > 0.0:
            cost = np.inf
            break
        PHt = product(P[:, columns], H.T)
        L = cholesky(product(H, PHt[columns]) + np.diag(inflation * variances))
        y = solve_lower(L, affine(H, e[columns, 0], innovation))
        cost = np.sum(y * y)
        if iteration == 0:
            squared = cost
        step = affine(PHt, solve_upper(L, y), -e[:, 0])
        e[:, 0] += step
        w, n = rotation_matrix(state.quaternion)[2], turn_of_the_world(state, gates)
        state, gates = corrected(state, step), _corrected_gates(gates, step)
        change = turn_of_the_world(state, gates) - n
        e, PHt = e + np.outer(change, dot(w, e)), PHt + np.outer(change, dot(w, PHt))
        P = carried_covariance(P, change, w)
        if np.max(np.abs(step)) < 1e-6:
            break
    if not math.isfinite(cost):
        unchanged = Belief(belief.navigation.copy(), belief.gates.copy(), belief.covariance.copy())
        return unchanged, Innovation(np.inf, np.inf)
    after = reduced(P, solve_lower(L, PHt.T).T)
    return Belief(navigation_vector(state), gates, after), Innovation(squared, cost)


def with_spacing(belief: Belief, gate: int, spacing: float, sigma: float) -> Belief:
    """Returns the belief that the spacing of a gate (by index) is a value with a sigma (m)."""
    index = DRONE + GATE * gate + AT_GATE.spacing
    P, before = belief.covariance, as_navigation(belief.navigation)
    scale = 1.0 / (P[index, index] + sigma * sigma)
    column = P[:, index].copy()
    error = column * (scale * (spacing - as_gate(belief.gates[gate]).spacing))
    state, gates = corrected(before, error), _corrected_gates(belief.gates, error)
    change = turn_of_the_world(state, gates) - turn_of_the_world(before, belief.gates)
    after = mirrored(P - np.outer(scale * column, column))
    after = carried_covariance(after, change, body_axes(belief)[2])
    return Belief(navigation_vector(state), gates, after)


@compiled
def relative_covariance(belief: Belief, gate: int) -> np.ndarray:
    """Returns the covariance of a gate's state as the drone has it before itself, (5, 5).

    It is that of (p_WG - p_WI, heading, spacing), both turned back by the error of the drone's
    heading, which turns the world as a whole:

        dp_G - dp_I - e_z x (p_G - p_I) w^T theta,   dpsi_G - w^T theta.
    """
    state = as_navigation(belief.navigation)
    w = rotation_matrix(state.quaternion)[2]
    offset = as_gate(belief.gates[gate]).p_WG - state.position
    columns = np.append(np.arange(POSE), DRONE + GATE * gate + np.arange(GATE))
    J = np.zeros((GATE, ACTIVE))
    J[:, POSE:] = np.eye(GATE)
    J[AT_GATE.p_WG, AT.position] = -np.eye(3)
    J[AT_GATE.p_WG, AT.theta] = -np.outer(cross(E_Z, offset), w)
    J[AT_GATE.heading, AT.theta] = -w
    return propagated(J, belief.covariance[columns][:, columns])


def attitude_sigma(belief: Belief) -> float:
    """Returns the greatest standard deviation of the attitude about an axis of B (rad)."""
    return math.sqrt(np.diag(belief.covariance)[AT.theta].max())


def body_axes(belief: Belief) -> np.ndarray:
    """Returns R_WB of a belief, (3, 3)."""
    return rotation_matrix(as_navigation(belief.navigation).quaternion)
