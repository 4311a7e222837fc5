"""Inverse dynamics in normalised time, with the thrust-axis angle in the place of yaw.

With s = t / T, T the duration of a leg, all forces are multiplied by T^2 and all angular
velocities by T: so both are functions of the derivatives with respect to s, and of T where
gravity comes in.
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from airrace.trajopt.flatness import axial_drag, moments, thrust_vectors, unit_vector
from airrace.trajopt.flight_limits import FlightLimits
from airrace.trajopt.reference import as_reference

if TYPE_CHECKING:
    from airrace.trajopt.time_optimal.lap_samples import LapSamples

_STEP = 1e-30  # of complex-step derivatives
# What the inverse dynamics depend on: (derivative, dimension), and then the unit of time.
_INPUTS = [(k, d) for k in (2, 3, 4) for d in range(3)] + [(k, 3) for k in range(3)]
_IN_AIR = [(1, d) for d in range(3)]  # and with drag


def angle_dynamics(
    flat: np.ndarray, units: np.ndarray, axes: Sequence[np.ndarray], limits: FlightLimits
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Returns the inverse dynamics with the thrust-axis angle in the place of yaw.

    Args:
        flat: samples as in trajopt/reference.py, in normalised time, (18, N), real
            or complex.
        units: of time (s), (N,).
        axes: of a body that does not turn about its thrust, see LapSamples.
        limits: for the vehicle.

    Returns:
        (thrusts, force, w, alpha): T^2 times the thrust of every rotor, (rotors, N),
        and the specific force, (3, N); T and T^2 times the angular velocity and
        acceleration in B, (3, N).
    """
    vehicle = limits.vehicle
    force, *rates = thrust_vectors(flat, units, limits.air)
    b, db, ddb = unit_vector(force, *rates)
    *_, angle, rate, acceleration = as_reference(flat)
    c, s = np.cos(angle), np.sin(angle)
    x, y = c * axes[0] + s * axes[1], c * axes[1] - s * axes[0]
    # The thrust's axis may be off the one that belongs to the axes, a little.
    x, y = x - np.sum(x * b, axis=0) * b, y - np.sum(y * b, axis=0) * b
    w = np.array([-np.sum(y * db, axis=0), np.sum(x * db, axis=0), rate])
    alpha = np.array(
        [
            -np.sum(y * ddb, axis=0) + w[1] * w[2],
            np.sum(x * ddb, axis=0) - w[0] * w[2],
            acceleration,
        ]
    )
    velocity = as_reference(flat).velocity
    thrust = vehicle.mass * (
        np.sqrt(np.sum(force * force, axis=0)) + axial_drag(velocity, b, units, limits.air)
    )
    wrench = np.vstack([thrust, moments(vehicle, w, alpha)])
    return limits.from_wrench @ wrench, force, w, alpha


class Linear(NamedTuple):
    """Quantities of samples in normalised time, and their gradients."""

    values: np.ndarray  #: rows, N
    gradients: np.ndarray  #: by derivatives with respect to normalised time, (rows, N, 5, 4)
    by_T: np.ndarray  #: by the duration of the sample's leg, (rows, N)

    def of(self, samples: slice) -> "Linear":
        """Returns those of some samples."""
        return Linear(*(each[:, samples] for each in self))


class LinearDynamics(NamedTuple):
    """Inverse dynamics of samples, with T the duration of the leg of a sample."""

    force: Linear  #: T^2 times the specific force that the thrust makes, 3 rows
    #: T^2 times the thrust of every rotor without its share of the thrust that balances this force,
    #: a row each.
    rest: Linear
    rate: Linear  #: T times the amount of the angular velocity, 1 row
    rates: Linear  #: T times the angular velocity in B, 3 rows

    @classmethod
    def linearize(cls, samples: "LapSamples") -> "LinearDynamics":
        """Args: samples: LapSamples."""
        limits = samples.limits
        inputs = _INPUTS if limits.air.is_still else _IN_AIR + _INPUTS
        copies = len(inputs) + 1
        axes = [np.tile(axis, copies) for axis in samples.axes]

        def quantities(flat, units):
            thrusts, force, w, _ = angle_dynamics(flat, units, axes, limits)
            share = limits.from_wrench[:, :1] * limits.vehicle.mass
            rest = thrusts - share * np.sqrt(np.sum(force * force, axis=0))
            return force, rest, np.sqrt(np.sum(w * w, axis=0) + 1e-12)[None], w

        return cls(*complex_step_gradients(quantities, samples.flat, samples.units, inputs))


def complex_step_gradients(
    function: Callable[[np.ndarray, np.ndarray], Sequence[np.ndarray]],
    flat: np.ndarray,
    units: np.ndarray,
    inputs: Sequence[tuple[int, int]],
) -> list[Linear]:
    """Returns every array that a function of samples makes, with its gradients.

    No digits cancel: Squire and Trapp, "Using complex variables to estimate derivatives of real
    functions" (SIAM Review 1998).

    Args:
        function: from M samples, (18, M), and their units, (M,), both complex, to arrays (rows, M);
            M is N times one more than there are inputs.
        flat: samples, References as vectors in normalised time, (18, N).
        units: of time (s), (N,).
        inputs: which derivatives of flat it depends on, as (derivative, dimension).
    """
    copies = np.repeat(flat[:, None], len(inputs) + 1, axis=1).astype(complex)
    T = np.repeat(units[None], len(inputs) + 1, axis=0).astype(complex)
    for i, (k, d) in enumerate(inputs):
        copies[3 * k + d if d < 3 else 15 + k, i] += 1j * _STEP
    T[-1] += 1j * _STEP
    result = []
    for x in function(copies.reshape(len(flat), -1), T.ravel()):
        x = x.reshape(len(x), len(inputs) + 1, len(units))
        gradients = np.zeros((len(x), len(units), 5, 4))
        for i, (k, d) in enumerate(inputs):
            gradients[:, :, k, d] = x[:, i].imag / _STEP
        result.append(Linear(x[:, -1].real, gradients, x[:, -1].imag / _STEP))
    return result
