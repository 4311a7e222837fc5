"""What the vehicle can do, as constraints on a step of a lap."""

import numpy as np

from airrace.trajopt.time_optimal.lap_step import LapStep
from airrace.vehicle import GRAVITY


def limit_dynamics(step: LapStep, band: float) -> None:
    """Adds the limits of speed, acceleration, angular velocity, lift and rotors.

    Args:
        step: to add to.
        band: share of a limit; samples farther from it are left out.
    """
    limits, dynamics = step.samples.limits, step.dynamics
    for leg, T in enumerate(step.lap.durations):
        here = step.of(leg)
        _cones(step, leg, 1, limits.max_speed, 1.0 - band)
        _cones(step, leg, 2, limits.max_acceleration, 1.0 - band)
        _rotors(step, leg, band)
        lift = dynamics.force[2, here]
        which = np.flatnonzero(lift < (1.0 + 2.0 * band) * limits.min_lift * T**2)
        rows = step.rows(
            leg,
            which,
            dynamics.d_force[2, here][which],
            dynamics.force_by_T[2, here][which] - 2.0 * T * limits.min_lift,
        )
        step.at_most(leg, -rows, lift[which] - limits.min_lift * T**2, limit=GRAVITY * T**2)
        rate = dynamics.rate[0, here]
        which = np.flatnonzero(rate > (1.0 - band) * limits.max_rate * T)
        rows = step.rows(
            leg,
            which,
            dynamics.d_rate[0, here][which],
            dynamics.rate_by_T[0, here][which] - limits.max_rate,
        )
        step.at_most(leg, rows, limits.max_rate * T - rate[which], limit=limits.max_rate * T)


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
    step.in_cones(leg, rows, values, limit=limit * T**order)


def _rotors(step, leg, band):
    """Adds least <= thrust <= most of each rotor.

    A rotor's thrust is a share of the norm of the force, which is convex and is
    kept as such in the upper limit, and a rest, which is linearised.
    """
    T, here, dynamics = step.lap.durations[leg], step.of(leg), step.dynamics
    vehicle, most = step.samples.limits.vehicle, step.samples.limits.max_thrusts
    share = step.samples.limits.from_wrench[:, 0] * vehicle.mass
    force, rest = dynamics.force[:, here], dynamics.rest[:, here]
    d_force, d_rest = dynamics.d_force[:, here], dynamics.d_rest[:, here]
    force_by_T, rest_by_T = dynamics.force_by_T[:, here], dynamics.rest_by_T[:, here]
    amount = np.linalg.norm(force, axis=0)
    thrust = share[:, None] * amount + rest
    high = thrust > (1.0 - band) * most[:, None] * T**2
    least = step.samples.limits.min_thrusts
    low = thrust < (least + band / 2.0 * most)[:, None] * T**2

    which = np.flatnonzero(high.any(axis=0))
    if len(which):
        norms = step.program.NewContinuousVariables(len(which))
        rows = [step.rows(leg, which, d_force[d, which], force_by_T[d, which]) for d in range(3)]
        step.in_cones(
            leg,
            np.stack([np.zeros_like(rows[0]), *rows], axis=1),
            np.column_stack([np.zeros(len(which)), force.T[which]]),
            norms,
        )
        # What torques do, as variables of their own: rotors outnumber torques.
        shares = step.samples.limits.from_wrench[:, 0 if step.samples.limits.drag else 1 :]
        from_rest = np.linalg.pinv(shares)
        torques = step.program.NewContinuousVariables(len(shares.T) * len(which)).reshape(
            len(shares.T), -1
        )
        for torque, row in zip(torques, from_rest):
            step.equal(
                leg,
                torque,
                step.rows(
                    leg, which, np.tensordot(row, d_rest[:, which], 1), row @ rest_by_T[:, which]
                ),
                row @ rest[:, which],
            )
        rotor, k = np.nonzero(high[:, which])
        rows = np.zeros((len(k), step.size(leg)))
        rows[:, -1] = -2.0 * T**2 * most[rotor]
        of_wrench = np.zeros((len(k), 1 + len(torques), len(which)))
        of_wrench[np.arange(len(k)), :, k] = np.column_stack([share[rotor], shares[rotor]])
        step.at_most(
            leg,
            np.hstack([rows, of_wrench.reshape(len(k), -1)]),
            T**2 * most[rotor],
            extra=[*norms, *torques.ravel()],
            limit=T**2 * most[rotor],
        )

    rotor, sample = np.nonzero(low)
    along = (force / amount)[:, sample]
    gradients = d_rest[rotor, sample] + share[rotor][:, None, None] * np.einsum(
        "dr,drox->rox", along, d_force[:, sample]
    )
    by_T = (
        rest_by_T[rotor, sample]
        + share[rotor] * np.sum(along * force_by_T[:, sample], axis=0)
        - 2.0 * T * least[rotor]
    )
    step.at_most(
        leg,
        -step.rows(leg, sample, gradients, by_T),
        thrust[rotor, sample] - T**2 * least[rotor],
        limit=T**2 * most[rotor],
    )
