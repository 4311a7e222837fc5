"""What the vehicle can do, as constraints on a step of a lap."""

import numpy as np

from airrace.trajopt.time_optimal.lap_step import LapStep
from airrace.vehicle import GRAVITY


def limit_dynamics(step: LapStep, band: float) -> None:
    """Adds the limits of speed, acceleration, angular velocity, lift and rotors.

    Args: band: share of a limit; samples farther from it are left out.
    """
    limits, dynamics = step.samples.limits, step.dynamics
    for leg, T in enumerate(step.lap.durations):
        here = step.of(leg)
        _cones(step, leg, 1, limits.max_speed, 1.0 - band)
        _cones(step, leg, 2, limits.max_acceleration, 1.0 - band)
        _rotors(step, leg, band)
        lift, d_lift, lift_by_T = (each[2] for each in dynamics.force.of(here))
        least = limits.min_lift * T**2
        which = np.flatnonzero(lift < (1.0 + 2.0 * band) * least)
        by_T = lift_by_T[which] - 2.0 * T * limits.min_lift
        rows = step.rows(leg, which, d_lift[which], by_T)
        step.at_most(leg, -rows, lift[which] - least, limit=GRAVITY * T**2)
        _rates(step, leg, dynamics.rate, np.array([limits.max_rate]), band)
        for sign in (1.0, -1.0):
            _rates(step, leg, dynamics.rates, np.array(limits.max_axis_rates), band, sign)


def _rates(step, leg, rates, limits, band, sign=1.0):
    """Adds sign * rate <= T limit, of quantities with limits, (rows,)."""
    T = step.lap.durations[leg]
    values, gradients, by_T = (sign * each for each in rates.of(step.of(leg)))
    most = T * limits
    row, which = np.nonzero(values > ((1.0 - band) * most)[:, None])
    rows = step.rows(leg, which, gradients[row, which], by_T[row, which] - limits[row])
    step.at_most(leg, rows, most[row] - values[row, which], limit=most[row])


def _cones(step, leg, order, limit, near):
    """Adds |derivative of the path| <= T^order limit."""
    if not np.isfinite(limit):
        return
    T, y = step.lap.durations[leg], step.samples.derivatives[:, leg]
    amount = np.linalg.norm(y[order, :, :3], axis=1)
    which = np.flatnonzero(amount > near * limit * T**order)
    if not len(which):
        return
    by_z, by_stretch = step.derivatives(leg, order)
    rows = np.zeros((len(which), 4, step.size(leg)))
    rows[:, 0, -1] = order * limit * T**order  # T^2 is linearised from below
    for d in range(3):
        rows[:, 1 + d, d:-2:4], rows[:, 1 + d, -1] = by_z[which], by_stretch[which, d]
    values = np.column_stack([np.full(len(which), limit * T**order), y[order, which, :3]])
    excess = np.repeat(step.excess[order - 1], len(rows)) if step.excess else None
    step.in_cones(leg, rows, values, excess, limit * T**order)


def _rotors(step, leg, band):
    """Adds least <= thrust <= most of each rotor.

    A rotor's thrust is a share of the norm of the force, which is convex and is
    kept as such in the upper limit, and a rest, which is linearised.
    """
    T, limits = step.lap.durations[leg], step.samples.limits
    least, most = (T**2 * limit for limit in (limits.min_thrusts, limits.max_thrusts))
    share = limits.from_wrench[:, 0] * limits.vehicle.mass
    force, d_force, force_by_T = step.dynamics.force.of(step.of(leg))
    rest, d_rest, rest_by_T = step.dynamics.rest.of(step.of(leg))
    amount = np.linalg.norm(force, axis=0)
    thrust = share[:, None] * amount + rest

    rotor, sample = np.nonzero(thrust > (1.0 - band) * most[:, None])
    if len(sample):
        which, k = np.unique(sample, return_inverse=True)
        norms = step.program.NewContinuousVariables(len(which))
        rows = [step.rows(leg, which, d_force[d, which], force_by_T[d, which]) for d in range(3)]
        step.in_cones(
            leg,
            np.stack([np.zeros_like(rows[0]), *rows], axis=1),
            np.column_stack([np.zeros(len(which)), force.T[which]]),
            norms,
        )
        by_T = rest_by_T[rotor, sample] - 2.0 / T * most[rotor]
        by_norm = np.zeros((len(rotor), len(which)))
        by_norm[np.arange(len(rotor)), k] = share[rotor]
        step.at_most(
            leg,
            np.hstack([step.rows(leg, sample, d_rest[rotor, sample], by_T), by_norm]),
            most[rotor] - rest[rotor, sample],
            extra=norms,
            limit=most[rotor],
        )

    rotor, sample = np.nonzero(thrust < least[:, None] + band / 2.0 * most[:, None])
    along = (force / amount)[:, sample]
    gradients = d_rest[rotor, sample] + share[rotor][:, None, None] * np.einsum(
        "dr,drox->rox", along, d_force[:, sample]
    )
    by_T = rest_by_T[rotor, sample] - 2.0 / T * least[rotor]
    by_T += share[rotor] * np.sum(along * force_by_T[:, sample], axis=0)
    rows = step.rows(leg, sample, gradients, by_T)
    step.at_most(leg, -rows, thrust[rotor, sample] - least[rotor], limit=most[rotor])
