"""How a drone comes down that does not know any more where it is."""

import dataclasses as dc

import numpy as np

from airrace.common.immutable import Immutable
from airrace.trajopt.stop import Stop


@dc.dataclass(frozen=True)
class Landing(Immutable):
    """Brakes in the direction of flight, and descends on the spot.

    It stands where a trajectory stands otherwise.

    Attributes:
        stop: from the state at the beginning.
    """

    stop: Stop

    def reference(self, time: float) -> np.ndarray:
        """Returns the sample at a time since the beginning (s), a Reference as a vector, (18,)."""
        braked = self.stop.braking_time
        return self.stop.reference(time, time - braked if time >= braked else None)
