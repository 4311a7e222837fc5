"""The wrench that a controller of one's own asks for, before the rotors share it."""

from typing import Any, NamedTuple

import numpy as np
from pydrake.systems.framework import DiscreteStateIndex, DiscreteValues

from airrace.common.jit import all_finite
from airrace.systems.contract import finite_vector

_WANTED = "total thrust (N) and moments (N m), [f, Mx, My, Mz]: an array of four finite numbers"


class OwnWrench(NamedTuple):
    """Checks what calc_wrench() of one's own returns, and counts where it is clipped."""

    who: str  #: name of the method
    clips: DiscreteStateIndex  #: number of negative thrusts so far, a state of the controller

    def checked(
        self, wrench: Any, reference: np.ndarray, estimate: np.ndarray, state: DiscreteValues
    ) -> np.ndarray:
        """Returns a wrench that rotors can be asked for, (4,).

        Rotors only push, so a negative thrust counts as none. A wrench may be NaN where an argument
        of calc_wrench() is not finite.

        Args:
            wrench: that calc_wrench() returned for a reference (18,) and an estimate (14,).
            state: of the controller, in which clips are counted.

        Raises:
            UserError: if it is not four finite numbers.
        """
        if not (all_finite(reference) and all_finite(estimate)):
            return np.full(4, np.nan)
        result = finite_vector(self.who, wrench, 4, _WANTED)
        if result[0] < 0.0:
            state.get_mutable_value(int(self.clips))[0] += 1.0
            result = np.array([0.0, *result[1:]])
        return result
