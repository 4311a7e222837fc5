"""Rotor thrusts and bearings along a lap, from positions and yaw alone.

This shares no formula with the planner: attitudes come from the second difference
of positions, angular velocities and accelerations from differences of attitudes.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from airrace.math.angles import wrap_angle
from airrace.trajopt.reference import as_reference
from airrace.trajopt.time_optimal.visibility import LEAST_RANGE
from airrace.vehicle import GRAVITY, Vehicle

_STEP = 1e-3  # s


def rotor_shares(lap, vehicle: Vehicle) -> tuple[float, float]:
    """Returns the least and the most of any rotor's thrust as a share of its limit.

    Args:
        lap: a Circuit, checked all around at 1 kHz, without drag.
        vehicle: that flies it.
    """
    h = _STEP
    # Six samples more than a lap, where it begins again: each difference loses some.
    times = (np.arange(int(lap.duration / h) + 6) * h) % lap.duration
    samples = lap.sample(times)
    p, yaw = as_reference(samples).position.T, as_reference(samples).yaw
    f = np.diff(p, 2, axis=0) / h**2 + [0.0, 0.0, GRAVITY]
    z_B = f / np.linalg.norm(f, axis=1, keepdims=True)
    y_B = np.cross(z_B, np.column_stack([np.cos(yaw), np.sin(yaw), 0.0 * yaw])[1:-1])
    y_B /= np.linalg.norm(y_B, axis=1, keepdims=True)
    R_WB = np.stack([np.cross(y_B, z_B), y_B, z_B], axis=2)
    # Central differences: w_B is that of the middle one of three samples.
    turns = Rotation.from_matrix(np.swapaxes(R_WB[:-2], 1, 2) @ R_WB[2:]).as_rotvec()
    w_W = np.einsum("nij,nj->ni", R_WB[:-2], turns / (2.0 * h))
    alpha_W = (w_W[2:] - w_W[:-2]) / (2.0 * h)
    R_WB, w_W, f = R_WB[2:-2], w_W[1:-1], f[2:-2]
    w_B, alpha_B = (np.einsum("nji,nj->ni", R_WB, v) for v in (w_W, alpha_W))
    J = np.array(vehicle.inertia)
    moments = J * alpha_B + np.cross(w_B, J * w_B)
    wrench = np.vstack([vehicle.mass * np.linalg.norm(f, axis=1), moments.T])
    shares = np.linalg.pinv(vehicle.allocation) @ wrench / vehicle.max_thrusts[:, None]
    return float(shares.min()), float(shares.max())


def greatest_bearing(lap, midpoints) -> float:
    """Returns the greatest bearing of the next gate off the heading, while it is far (rad).

    Args: lap: a Circuit. midpoints: of its gates, (n, 3) m.
    """
    times = np.arange(0.0, lap.duration, 1e-3)
    samples = lap.sample(times)
    following = np.searchsorted(lap.gate_times, times, side="right") % len(midpoints)
    to_gate = midpoints[following].T[:2] - samples[:2]
    off = np.arctan2(to_gate[1], to_gate[0]) - as_reference(samples).yaw
    return float(np.abs(wrap_angle(off))[np.linalg.norm(to_gate, axis=0) > LEAST_RANGE].max())
