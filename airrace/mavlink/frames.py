"""From the world W and the body B to the wire's frames, NED and FRD, and back.

W has z up, B has x forward and y to the left. North is the world's x axis, so that both pairs of
frames differ by half a turn about x, which is its own inverse: the same functions lead back.
"""

from typing import NamedTuple

import numpy as np

from airrace.vehicle.state import State


def flipped(v: np.ndarray) -> np.ndarray:
    """Returns a vector of W in NED, or of B in FRD, and the other way round, (3,)."""
    return np.array([v[0], -v[1], -v[2]])


def flipped_quaternion(q: np.ndarray) -> np.ndarray:
    """Returns the quaternion (w, x, y, z) of the same rotation between the other frames, (4,)."""
    return np.array([q[0], q[1], -q[2], -q[3]])


def euler_angles(q: np.ndarray) -> tuple[float, float, float]:
    """Returns roll, pitch and yaw (rad) of a quaternion of any length, (4,): z, then y, then x."""
    w, x, y, z = q / np.linalg.norm(q)
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return float(roll), float(pitch), float(yaw)


class NedState(NamedTuple):
    """Motion of the drone as the wire has it."""

    position: np.ndarray  # from where it was armed (m), NED, (3,)
    velocity: np.ndarray  # (m/s), NED, (3,)
    quaternion: np.ndarray  # from FRD to NED, (4,), of length 1
    rates: np.ndarray  # angular velocity in FRD (rad/s), (3,)


def ned_state(state: State, R_WB: np.ndarray, origin: np.ndarray) -> NedState:
    """Returns the motion of a state.

    Args: state: of the drone. R_WB: its attitude, (3, 3). origin: of LOCAL_NED in W (m), (3,).
    """
    q = flipped_quaternion(np.asarray(state.quaternion))
    return NedState(
        flipped(state.position - origin),
        flipped(state.velocity),
        q / np.linalg.norm(q),
        flipped(R_WB.T @ state.angular_velocity),
    )
