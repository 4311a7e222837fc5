"""Motion blur: a picture shows all that the camera sees while its shutter is open."""

import functools
import math

import cv2
import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from airrace.common.jit import compiled

_DISTANCE = 10.0  # how far away a thing is whose blur decides on the effort (m)
_SHARP = 1.0  # blur up to here is not drawn (px)
_STEP = 2.5  # blur that one exposure stands for (px)
_MOST = 6  # exposures a picture


def moved(X_WB, w_WB, v_WB, dt) -> RigidTransform:
    """Returns a pose after a time of constant velocities.

    Args:
        X_WB: pose of the body.
        w_WB: angular velocity in world (rad/s), (3,).
        v_WB: velocity of the body's origin in world (m/s), (3,).
        dt: may be negative (s).
    """
    rate = math.sqrt(np.dot(w_WB, w_WB))
    R_WB = X_WB.rotation()
    if rate > 0:
        R_WB = RotationMatrix(AngleAxis(rate * dt, w_WB / rate)) @ R_WB
    return RigidTransform(R_WB, X_WB.translation() + dt * v_WB)


class MeanPicture:
    """The mean of several pictures by a renderer that draws whole ones."""

    def __init__(self, render, poses, X_WC=None):
        """Constructs the picture.

        Args:
            render: draws one; called with X_WC and the array to draw into.
            poses: pairs of a weight and X_WC; the weights add up to 1.
            X_WC: ignored: the pose in the middle.
        """
        self._render, self._poses = render, poses

    def draw(self, out, boxes=None) -> None:
        """Draws it.

        Args:
            out: RGBA or grey levels, see pixels.py; overwritten.
            boxes: ignored: the parts that must be drawn.
        """
        (total, X_WC), *others = self._poses
        self._render(X_WC, out)
        picture = np.empty_like(out) if others else None
        for weight, X_WC in others:
            self._render(X_WC, picture)
            total = add_picture(out, total, picture, weight)


def add_picture(mean, total, picture, weight) -> float:
    """Adds a picture to a weighted mean in place.

    Args:
        mean: of pictures whose weights add up to ``total``.
        picture, weight: the one to add.

    Returns:
        what all weights now add up to.
    """
    share = weight / (total + weight)
    cv2.addWeighted(mean, 1 - share, picture, share, 0.0, dst=mean)
    return total + weight


class Shutter:
    """Tells from where to look for one picture.

    The picture is the mean over the time that the shutter is open, which ranges
    from half of it before to half of it after the sampled pose. That integral
    is done by Gauss-Legendre quadrature with as many poses as the blur is long:
    its centre and its variance are exact with two of them already, and so is
    the parallax, as every pose is drawn.
    """

    def __init__(self, *, time, camera_info):
        """Args: time: how long it is open (s). camera_info: calibration."""
        self._time = time
        self._X_BC = camera_info.X_BC
        # Rays to the picture's middle and halfway to its sides and corners.
        w, h = camera_info.width, camera_info.height
        pixels = np.array([[w * x, h * y, 4.0] for x in (1, 2, 3) for y in (1, 2, 3)]) / 4
        self._K = camera_info.K
        self._p_C = _DISTANCE * pixels @ np.linalg.inv(self._K).T

    def poses(self, X_WB, w_WB, v_WB) -> list:
        """Returns pairs of a weight and X_WC; the weights add up to 1.

        Args: see moved(); all in the middle of the exposure.
        """

        def X_WC(t):
            return moved(X_WB, w_WB, v_WB, t) @ self._X_BC

        if self._time == 0:
            return [(1.0, X_WC(0.0))]
        half = self._time / 2
        X_01 = X_WC(-half).InvertAndCompose(X_WC(half))
        length = _longest_way(X_01.rotation().matrix(), X_01.translation(), self._K, self._p_C)
        if length <= _SHARP:
            return [(1.0, X_WC(0.0))]
        nodes, weights = _quadrature(min(max(2, int(np.ceil(length / _STEP))), _MOST))
        return [(weight, X_WC(half * node)) for node, weight in zip(nodes, weights)]


@compiled
def _longest_way(R_01, p_01, K, p_C):
    """Returns the longest way of a nominal point, (n, 3), in the picture (px).

    Args: R_01, p_01: from the beginning of the exposure to its end. K: calibration.
    """
    farthest, before, after = 0.0, np.empty(3), np.empty(3)
    for p in p_C:
        before[:], after[:] = 0.0, 0.0
        for row in range(3):
            moved_by = p_01[row]
            for j in range(3):
                moved_by += R_01[row, j] * p[j]
            for i in range(3):
                before[i] += K[i, row] * p[row]
                after[i] += K[i, row] * moved_by
        depth = max(after[2], 0.1 * _DISTANCE)
        x, y = after[0] / depth - before[0] / before[2], after[1] / depth - before[1] / before[2]
        farthest = max(farthest, math.hypot(x, y))
    return farthest


@functools.cache
def _quadrature(n):
    """Returns nodes in [-1, 1] and weights that add up to 1."""
    nodes, weights = np.polynomial.legendre.leggauss(n)
    return nodes.tolist(), (weights / 2).tolist()
