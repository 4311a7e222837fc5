"""The clock by which plans are flown: the race's, less a delay that may grow."""

from typing import NamedTuple

import numpy as np

from airrace.common.packing import Packing
from airrace.systems.planning.lap_plan import LapPlan
from airrace.trajopt.flat_trajectory import flat_outputs


class PathClock(NamedTuple):
    """How far plans are behind, as of a time. All zeros: they are flown as they were planned."""

    time: float  #: of the race (s)
    delay: float  #: s
    #: slowing, slowing_rate, ...: the delay's derivatives (s^0, s^-1, s^-2, s^-3); the last one
    #: stays as it is. With a slowing of 1, the clock stands.
    slowing: float
    slowing_rate: float
    slowing_acceleration: float
    slowing_jerk: float

    def after(self, time: float) -> "PathClock":
        """Returns the clock at a later time (s)."""
        t, (_, d, d1, d2, d3, d4) = time - self.time, self
        return PathClock(
            time,
            d + t * (d1 + t / 2 * (d2 + t / 3 * (d3 + t / 4 * d4))),
            d1 + t * (d2 + t / 2 * (d3 + t / 3 * d4)),
            d2 + t * (d3 + t / 2 * d4),
            d3 + t * d4,
            d4,
        )

    @property
    def is_regular(self) -> bool:
        """Whether the delay stays as it is."""
        return not any(self[2:])

    def derivatives(self, plan: LapPlan, time: float) -> np.ndarray:
        """Returns value and four derivatives of x, y, z, yaw of a plan, (5, 4), at a time (s).

        With the plan's time s(t) = t - delay(t), they are those of a composition (formula of Faa
        di Bruno), so a reference of them is what a drone can fly: position, velocity, and the
        attitude and rates that follow from acceleration, jerk and snap fit to each other.
        """
        now = self.after(time)
        p, v, a, j, s = plan.derivatives(time - now.delay)
        s1, s2, s3, s4 = 1.0 - now.slowing, *(-d for d in now[3:])
        return np.array(
            [
                p,
                v * s1,
                a * s1**2 + v * s2,
                j * s1**3 + 3.0 * a * s1 * s2 + v * s3,
                s * s1**4 + 6.0 * j * s1**2 * s2 + a * (3.0 * s2**2 + 4.0 * s1 * s3) + v * s4,
            ]
        )

    def reference(self, plan: LapPlan, time: float) -> np.ndarray:
        """Returns the sample of trajopt/reference.py of a plan at a time (s), (18,)."""
        if self.is_regular:
            return plan.reference(time - self.delay)
        return flat_outputs(self.derivatives(plan, time))


_PACKING = Packing(PathClock)
as_clock, clock_vector, CLOCK_SIZE = _PACKING.parts, _PACKING.vector, _PACKING.size
REGULAR = PathClock(*CLOCK_SIZE * [0.0])
REGULAR_VECTOR = clock_vector(REGULAR)  # for ports that are left open
