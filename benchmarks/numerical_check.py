"""Rotor thrusts along a lap, from positions and yaw alone.

This shares no formula with the planner: attitudes come from the second difference
of positions, angular velocities and accelerations from differences of attitudes.
"""

import numpy as np

from airrace.trajopt.flat_trajectory import POSITION, YAW
from airrace.vehicle import GRAVITY, Vehicle

_STEP = 1e-3  # s


def rotor_shares(lap, vehicle: Vehicle) -> tuple[float, float]:
    """Returns the least and the most of any rotor's thrust as a share of its limit.

    Args:
        lap: a Circuit, checked all around at 1 kHz, without drag.
        vehicle: that flies it.
    """
    h = _STEP
    count = int(lap.duration / h)
    # A little beyond the end, where the lap begins again.
    samples = lap.sample((np.arange(count + 6) * h) % lap.duration)
    p, yaw = samples[POSITION].T, samples[YAW]
    force = np.diff(p, 2, axis=0) / h**2 + [0.0, 0.0, GRAVITY]
    thrust = vehicle.mass * np.linalg.norm(force, axis=1)
    z = force / np.linalg.norm(force, axis=1, keepdims=True)
    heading = np.column_stack([np.cos(yaw), np.sin(yaw), 0.0 * yaw])[1:-1]
    y = np.cross(z, heading)
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    R = np.stack([np.cross(y, z), y, z], axis=2)
    # Rotations from one sample to the next but one, as vectors: w is at the middle one.
    E = np.swapaxes(R[:-2], 1, 2) @ R[2:]
    angle = np.arccos(np.clip((np.trace(E, axis1=1, axis2=2) - 1.0) / 2.0, -1.0, 1.0))
    turn = (
        np.column_stack([E[:, 2, 1] - E[:, 1, 2], E[:, 0, 2] - E[:, 2, 0], E[:, 1, 0] - E[:, 0, 1]])
        / 2.0
    )
    turn *= (np.maximum(angle, 1e-12) / np.maximum(np.sin(angle), 1e-12))[:, None]
    w = np.einsum("nij,nj->ni", R[:-2], turn / (2.0 * h))  # in the world
    alpha = (w[2:] - w[:-2]) / (2.0 * h)
    R, w, thrust = R[2:-2], w[1:-1], thrust[2:-2]
    w_B, alpha_B = (np.einsum("nji,nj->ni", R, v) for v in (w, alpha))
    J = np.array(vehicle.inertia)
    moment = J * alpha_B + np.cross(w_B, J * w_B)
    thrusts = np.linalg.pinv(vehicle.allocation) @ np.vstack([thrust, moment.T])
    shares = thrusts / vehicle.max_thrusts[:, None]
    return float(shares.min()), float(shares.max())
