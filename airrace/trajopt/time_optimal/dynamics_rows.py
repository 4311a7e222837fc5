"""The rotor limits about a lap, as derivatives."""

import dataclasses as dc

import numpy as np

from airrace.trajopt.reference import REFERENCE_SIZE, as_reference
from airrace.trajopt.time_optimal.lap_samples import LapSamples, twisted_dynamics

_STEP = 1e-30  # of the complex-step derivative: no digits cancel
# What the inverse dynamics depend on: (derivative, dimension), and then the unit of time.
_INPUTS = [(k, d) for k in (1, 2, 3, 4) for d in range(3)] + [(k, 3) for k in range(3)]
_ROWS = np.hstack(as_reference(np.arange(REFERENCE_SIZE))[1:])  # all but the position


@dc.dataclass(frozen=True, eq=False)
class DynamicsRows:
    """Inverse dynamics of samples in normalised time, and their gradients.

    With T the duration of the leg of a sample:

    Attributes:
        force: T^2 times the specific force that the thrust makes, (3, N).
        rest: T^2 times the thrust of every rotor without its share of the thrust
            that balances this force, (rotors, N).
        rate: T times the amount of the angular velocity, (1, N).
        d_force, d_rest, d_rate: by derivatives with respect to normalised time,
            (rows, N, 5, 4).
        force_by_T, rest_by_T, rate_by_T: by T, (rows, N).
    """

    force: np.ndarray
    rest: np.ndarray
    rate: np.ndarray
    d_force: np.ndarray
    d_rest: np.ndarray
    d_rate: np.ndarray
    force_by_T: np.ndarray
    rest_by_T: np.ndarray
    rate_by_T: np.ndarray

    @classmethod
    def linearize(cls, samples: LapSamples) -> "DynamicsRows":
        """Args: samples: of the lap."""
        vehicle = samples.limits.vehicle
        N, count = len(samples.units), len(_INPUTS) + 1
        flat = np.repeat(samples.flat[:, None], count, axis=1).astype(complex)
        T = np.repeat(samples.units[None], count, axis=0).astype(complex)
        for i, row in enumerate(_ROWS):
            flat[row, i] += 1j * _STEP
        T[-1] += 1j * _STEP
        axes = [np.tile(axis, count) for axis in samples.axes]
        thrusts, force, w, _ = twisted_dynamics(
            flat.reshape(18, -1), T.ravel(), axes, samples.limits
        )
        share = samples.limits.from_wrench[:, :1] * vehicle.mass
        rest = thrusts - share * np.sqrt(np.sum(force * force, axis=0))
        rate = np.sqrt(np.sum(w * w, axis=0) + 1e-12)[None]
        values, gradients, by_T = [], [], []
        for x in (force, rest, rate):
            x = x.reshape(len(x), count, N)
            d = np.zeros((len(x), N, 5, 4))
            for i, (k, dim) in enumerate(_INPUTS):
                d[:, :, k, dim] = x[:, i].imag / _STEP
            values.append(x[:, -1].real)
            gradients.append(d)
            by_T.append(x[:, -1].imag / _STEP)
        return cls(*values, *gradients, *by_T)
