"""Motion blur: a picture shows all that the camera sees while its shutter is open."""

import dataclasses as dc
import functools
import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import ArrayLike
from pydrake.common.eigen_geometry import AngleAxis, Quaternion
from pydrake.math import RigidTransform, RotationMatrix

from airrace.common.jit import compiled
from airrace.math.vec3 import rotate
from airrace.vehicle.state import State

if TYPE_CHECKING:
    from airrace.vehicle.camera_info import CameraInfo

_DISTANCE = 10.0  # how far away a thing is whose blur decides on the effort (m)
_SHARP = 1.0  # blur up to here is not drawn (px)
_STEP = 2.5  # blur that one exposure stands for (px)
_MOST = 6  # exposures a picture


def pose_of(state: State, dt: float = 0.0) -> RigidTransform:
    """Returns X_WB of a state after a time (s) of constant velocities; see moved()."""
    q = state.quaternion / np.linalg.norm(state.quaternion)  # integrators let it drift
    X_WB = RigidTransform(Quaternion(q), state.position)
    if dt == 0.0:
        return X_WB
    return moved(X_WB, state.angular_velocity, state.velocity, dt)


def moved(X_WB: RigidTransform, w_WB: np.ndarray, v_WB: np.ndarray, dt: float) -> RigidTransform:
    """Returns a pose after a time dt (s), maybe negative, of constant velocities in the world."""
    rate = math.sqrt(np.dot(w_WB, w_WB))
    R_WB = X_WB.rotation()
    if rate > 0:
        R_WB = RotationMatrix(AngleAxis(rate * dt, w_WB / rate)) @ R_WB
    return RigidTransform(R_WB, X_WB.translation() + dt * v_WB)


@dc.dataclass(frozen=True)
class MeanPicture:
    """The mean of several pictures by a renderer that draws whole ones."""

    #: Draws one; called with X_WC and the array to draw into.
    render: Callable[[RigidTransform, np.ndarray], None]
    poses: list  #: pairs of a weight and X_WC; the weights add up to 1
    X_WC: RigidTransform | None = None  #: that in the middle, which is not used

    def draw(self, out: np.ndarray, boxes: ArrayLike | None = None) -> None:
        """Draws all of it, whatever the boxes; see Exposure.draw()."""
        (total, X_WC), *others = self.poses
        self.render(X_WC, out)
        picture = np.empty_like(out)
        for weight, X_WC in others:
            self.render(X_WC, picture)
            total += weight
            share = weight / total
            cv2.addWeighted(out, 1 - share, picture, share, 0.0, dst=out)


class Shutter:
    """Tells from which poses to draw one picture.

    The picture is the mean over the time that the shutter is open, which ranges
    from half of it before to half of it after the sampled pose. That integral
    is done by Gauss-Legendre quadrature with as many poses as the blur is long:
    its centre and its variance are exact with two of them already, and so is
    the parallax, as every pose is drawn.
    """

    def __init__(self, *, time: float, camera_info: "CameraInfo"):
        """Args: time: how long it is open (s). camera_info: calibration."""
        self._time = time
        self._X_BC = camera_info.X_BC
        # Points before the picture's middle and halfway to its sides and corners.
        w, h = camera_info.width, camera_info.height
        self._pixels = np.array([[w * x, h * y, 4.0] for x in (1, 2, 3) for y in (1, 2, 3)]) / 4
        self._K = camera_info.K
        self._p_C = _DISTANCE * self._pixels @ np.linalg.inv(self._K).T

    def poses(self, X_WB: RigidTransform, w_WB: np.ndarray, v_WB: np.ndarray) -> list:
        """Returns pairs of a weight and X_WC; the weights add up to 1.

        Args: see moved(); all in the middle of the exposure.
        """

        def X_WC(t):
            return moved(X_WB, w_WB, v_WB, t) @ self._X_BC

        if self._time == 0:
            return [(1.0, X_WC(0.0))]
        half = self._time / 2
        X_01 = X_WC(-half).InvertAndCompose(X_WC(half))
        R_01, p_01 = X_01.rotation().matrix(), X_01.translation()
        length = _longest_motion(R_01, p_01, self._K, self._p_C, self._pixels)
        if length <= _SHARP:
            return [(1.0, X_WC(0.0))]
        nodes, weights = _quadrature(min(max(2, math.ceil(length / _STEP)), _MOST))
        return [(weight, X_WC(half * node)) for node, weight in zip(nodes, weights)]


@compiled
def _longest_motion(R_01, p_01, K, points, pixels):
    """Returns how far one of some points moves in the picture at most (px).

    Args:
        R_01, p_01: the camera's pose at the end of the exposure, in that at its beginning.
        K: calibration.
        points, pixels: in the camera's frame at the beginning (m), and in the picture, (n, 3).
    """
    longest = 0.0
    for p, pixel in zip(points, pixels):
        q = rotate(R_01, p) + p_01
        x, y, _ = rotate(K, q) / max(q[2], 0.1 * _DISTANCE)
        longest = max(longest, math.hypot(x - pixel[0], y - pixel[1]))
    return longest


@functools.cache
def _quadrature(n):
    """Returns nodes in [-1, 1] and weights that add up to 1."""
    nodes, weights = np.polynomial.legendre.leggauss(n)
    return nodes.tolist(), (weights / 2).tolist()
