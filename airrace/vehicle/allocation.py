"""From a commanded wrench to rotor thrusts within their limits."""

import itertools

import numpy as np
from numpy.typing import ArrayLike

from airrace.common.jit import compiled
from airrace.math.small_matrices import apply

# Of a deviation in [f, Mx, My, Mz], each as a share of what the rotors can do,
# and of a rotor's thrust as a share of its limit.
_WEIGHTS = np.array([1e2, 1e5, 1e5, 1.0])
_EFFORT = 1e-2


class Allocator:
    """Distributes thrust and moments over the rotors of a vehicle.

    Within the limits it is the Moore-Penrose pseudo-inverse. At a limit it is
    the bounded weighted least squares problem of Smeur, Hoeppener and De
    Wagter, "Prioritized control allocation for quadrotors subject to
    saturation" (IMAV 2017), equation (14), solved by the active-set method of
    Harkegard (CDC 2002): yaw is given up first, then total thrust, and roll
    and pitch, which hold the drone up, only where no thrusts produce them.

    Attributes:
        inverse: from [f, Mx, My, Mz] to the thrusts, (n, 4); see by_inverse().
        is_complete: whether the rotors produce every wrench that is near zero: a
            lost one can leave fewer axes than the pseudo-inverse needs.
    """

    def __init__(self, allocation: np.ndarray, max_thrusts: np.ndarray, yaw: bool = True):
        """Args: see Vehicle; a lost rotor has no thrust. yaw: whether its moment matters at all."""
        self._limits = np.array(max_thrusts, float)
        self._working = np.flatnonzero(max_thrusts > 0)
        self._rows = slice(0, 4 if yaw else 3)
        self._B = allocation[self._rows, self._working]
        self._max = max_thrusts[self._working]
        self.inverse = np.zeros((len(max_thrusts), 4))
        self.inverse[self._working, self._rows] = np.linalg.pinv(self._B)
        self.is_complete = bool(np.linalg.matrix_rank(self._B) == len(self._B))
        # In shares of the limits: of a rotor, and of all rotors together.
        most = np.maximum(np.abs(self._B) @ self._max, 1e-9)
        self._scale = _WEIGHTS[self._rows] / most
        weighted = self._scale[:, None] * self._B * self._max
        self._A = np.vstack([weighted, _EFFORT * np.eye(len(self._max))])

    def allocate(self, wrench: np.ndarray) -> np.ndarray:
        """Returns the thrusts (n,) for a wrench [f, Mx, My, Mz], shape (4,)."""
        thrusts, possible = by_inverse(self.inverse, wrench, self._limits)
        if not (possible and self.is_complete) and len(self._max):
            b = np.concatenate([self._scale * wrench[self._rows], np.zeros(len(self._max))])
            start = np.clip(thrusts[self._working] / self._max, 0.0, 1.0)
            thrusts[self._working] = self._max * _least_squares_in_unit_box(self._A, b, start)
        return thrusts


@compiled
def by_inverse(
    inverse: np.ndarray, wrench: np.ndarray, limits: np.ndarray
) -> tuple[np.ndarray, bool]:
    """Returns inverse @ wrench, (n,), and whether all of it is between zero and the limits.

    Args: inverse, wrench: see Allocator. limits: (n,) in N.
    """
    thrusts = apply(inverse, wrench)
    return thrusts, bool(np.all((thrusts >= 0.0) & (thrusts <= limits)))


def _least_squares_in_unit_box(A: np.ndarray, b: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Minimises |A x - b| over 0 <= x <= 1, by active sets.

    Args:
        A: (m, n) of full column rank. b: (m,). x: where to start, (n,).
    """
    free = (x > 0.0) & (x < 1.0)
    largest = np.abs(A).max()
    rounding = 1e-14 * largest * max(largest, np.abs(b).max())
    for _ in range(4 * len(x)):  # ample: a few are the rule, and any x will fly
        step = np.zeros(len(x))
        if free.any():
            step[free] = np.linalg.lstsq(A[:, free], b - A @ x, rcond=None)[0]
        # How far along the step each element may go.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            room = np.where(step > 0, (1.0 - x) / step, np.where(step < 0, -x / step, np.inf))
        first = room.argmin()
        if room[first] < 1.0:
            x = np.clip(x + room[first] * step, 0.0, 1.0)
            x[first] = float(step[first] > 0)
            free[first] = False
            continue
        x = np.clip(x + step, 0.0, 1.0)
        # Which fixed element would lower the cost most by leaving its limit?
        slope = A.T @ (b - A @ x)
        gain = np.where(free, 0.0, np.where(x > 0.5, -slope, slope))
        if gain.max() <= rounding:
            break
        free[gain.argmax()] = True
    return x


def wrench_margin(allocation: np.ndarray, max_thrusts: np.ndarray, wrench: ArrayLike) -> float:
    """Returns how far a wrench is inside of what the rotors can produce.

    The set of all wrenches within 0 <= thrust <= limit is a zonotope; the
    result is the least distance to its facets, with every component as a share
    of its greatest amount, and negative outside. A drone can be controlled
    around a hover if that is positive: Du, Quan, Cai, "Controllability
    analysis and degraded control for a class of hexacopters subject to rotor
    failures" (J. Intell. Robot. Syst. 2015), theorems 1 and 2.

    Args:
        allocation: (m, n), rows as in Vehicle.allocation, or the first of them.
        max_thrusts: (n,) in N.
        wrench: (m,).
    """
    working = max_thrusts > 0
    scale = np.maximum(np.abs(allocation) @ max_thrusts, 1e-9)
    generators = (allocation * max_thrusts)[:, working] / scale[:, None]
    centre = generators.sum(axis=1) / 2
    if np.linalg.matrix_rank(generators) < len(generators):
        return -np.inf
    margin = np.inf
    # A facet is spanned by m - 1 generators; its normal is their null space.
    for facet in itertools.combinations(generators.T, len(generators) - 1):
        _, s, Vt = np.linalg.svd(np.array(facet))
        if s[-1] < 1e-9:
            continue
        reach = np.abs(Vt[-1] @ generators).sum() / 2
        margin = min(margin, reach - abs(Vt[-1] @ (wrench / scale - centre)))
    return float(margin)
