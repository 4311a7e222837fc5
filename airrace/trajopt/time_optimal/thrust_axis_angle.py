"""The angle of the body about its thrust axis, in the place of yaw.

Yaw torque is what multirotors have least of. A body that tilts without turning
about its thrust carries its x and y axes along by parallel transport; relative to
those, the second derivative of the body's angle is the angular
acceleration about z, whatever the tilt does. In terms of a heading, that would be a
small difference of large terms.
"""

from collections.abc import Sequence

import numpy as np

from airrace.trajopt.flat_trajectory import pack
from airrace.trajopt.flatness import thrust_vectors, unit_vector
from airrace.trajopt.time_optimal.dynamics import complex_step_gradients
from airrace.vehicle.air import Air

_NODES, _WEIGHTS = (0.5 * (x + o) for x, o in zip(np.polynomial.legendre.leggauss(4), (1.0, 0.0)))


def quadrature(fractions: np.ndarray) -> np.ndarray:
    """Returns nodes between fractions of a leg, the first 0, and on to 1, (4 samples,)."""
    ends = np.append(fractions, 1.0)
    return (ends[:-1, None] + np.diff(ends)[:, None] * _NODES).ravel()


def transported_axes(
    derivatives: np.ndarray,
    between: np.ndarray,
    durations: np.ndarray,
    fractions: np.ndarray,
    chart: np.ndarray,
    air: Air,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Returns the axes of a body that flies a lap without turning about its thrust.

    The least rotation that takes the vertical to the thrust's axis b turns about
    b at (b_y db_x - b_x db_y) / (1 + b_z); the body must turn back by as much.

    Args:
        derivatives: of samples in normalised time, (5, n, samples, 4).
        between: likewise at the quadrature()'s nodes.
        durations: of legs, (n,) s. fractions: of the samples, (samples,).
        chart: see LapSpline.
        air: that is flown through.

    Returns:
        (x axes, y axes, turn): in the world, (3, n samples) each; and the angle
        that a lap must add for its end to meet its start (rad), without full turns.
    """
    n, samples = derivatives.shape[1:3]
    flat, units = pack(between.reshape(5, -1, 4)), np.repeat(durations, between.shape[2])
    rate = _least_rotation_rate(*_thrust_axes(flat, units, chart, air))
    widths = np.diff(np.append(fractions, 1.0))
    angle = np.sum(rate.reshape(n, samples, -1) * _WEIGHTS, axis=2) * widths
    angle = np.cumsum(angle.ravel())
    turn = float(angle[-1])
    angle = np.concatenate([[0.0], angle[:-1]])
    flat = pack(derivatives.reshape(5, -1, 4))
    b, _ = _thrust_axes(flat, np.repeat(durations, samples), chart, air)
    e1, e2 = (chart.T @ axis for axis in least_rotation_axes(b))
    c, s = np.cos(angle), np.sin(angle)
    return c * e1 - s * e2, s * e1 + c * e2, turn


def turn_gradients(
    between: np.ndarray, durations: np.ndarray, fractions: np.ndarray, chart: np.ndarray, air: Air
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns how the turn of the transported axes depends on the lap.

    Args: see transported_axes().

    Returns:
        (gradients, by_T, sums): of the rate at the nodes, by derivatives in
        normalised time, (n, nodes, 5, 4), and by the leg's duration, (n, nodes);
        and from those rates to the turn from a leg's start to its samples and to
        its end, (samples + 1, nodes).
    """
    n, count = between.shape[1:3]

    def rates(flat, units):
        return [_least_rotation_rate(*_thrust_axes(flat, units, chart, air))[None]]

    inputs = [(k, d) for k in ((2, 3) if air.is_still else (1, 2, 3)) for d in range(3)]
    flat, units = pack(between.reshape(5, -1, 4)), np.repeat(durations, count)
    [(_, gradients, by_T)] = complex_step_gradients(rates, flat, units, inputs)
    widths = np.diff(np.append(fractions, 1.0))
    each = np.kron(np.diag(widths), _WEIGHTS)
    sums = np.vstack([np.zeros(count), np.cumsum(each, axis=0)])
    return gradients.reshape(n, count, 5, 4), by_T.reshape(n, count), sums


def least_rotation_axes(b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the x and y axes that the least rotation from the vertical to b gives, (3, N) each.

    Args: b: unit vectors, (3, N).
    """
    k = 1.0 / (1.0 + b[2])
    return (
        np.array([1.0 - k * b[0] ** 2, -k * b[0] * b[1], -b[0]]),
        np.array([-k * b[0] * b[1], 1.0 - k * b[1] ** 2, -b[1]]),
    )


def _least_rotation_rate(b, db):
    """Returns how fast the least rotation from the vertical to b turns about b, (N,) rad."""
    return (b[1] * db[0] - b[0] * db[1]) / (1.0 + b[2])


def _thrust_axes(flat, units, chart, air):
    """Returns unit vectors along the thrust, and their derivatives, (3, N) each, after a chart."""
    return [chart @ each for each in unit_vector(*thrust_vectors(flat, units, air))[:2]]


def yaw_of_attitude(axes: Sequence[np.ndarray], w: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Returns the yaw of an attitude, as attitude_from_force() defines it.

    The heading is horizontal and at right angles to the body's y axis.

    Args:
        axes: x, y, z of the body in the world, (3, N) each.
        w, alpha: angular velocity and acceleration in B, (3, N).

    Returns: yaw, its rate and acceleration (3, N), unwrapped.
    """
    x, y, z = axes
    # The y axis turns: its derivatives are R (w x e_y) and so on.
    dy = w[0] * z - w[2] * x
    ddy = alpha[0] * z - alpha[2] * x + w[1] * (w[0] * x + w[2] * z) - (w[0] ** 2 + w[2] ** 2) * y
    square = y[0] ** 2 + y[1] ** 2
    cross = y[0] * dy[1] - y[1] * dy[0]
    rate = cross / square
    acceleration = (y[0] * ddy[1] - y[1] * ddy[0]) / square - rate * 2.0 * (
        y[0] * dy[0] + y[1] * dy[1]
    ) / square
    return np.array([np.unwrap(np.arctan2(-y[0], y[1])), rate, acceleration])
