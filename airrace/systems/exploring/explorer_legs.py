"""Plans the explorer's legs, and checks them as the map grows."""

import numpy as np

from airrace.systems.exploring import clear_paths as ways
from airrace.systems.exploring.exploration import Now, gate_pose
from airrace.track.gate_map import GateEstimate
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.min_snap.leg import plan_leg

_SLOW = 1.0  # m/s
_BRAKING_TIMES = (0.7, 1.0, 0.5, 1.5)  # s, for which to go on as now, to where it stops


class LegPlanner:
    """Plans legs that are clear by what is known.

    All legs start from where the present one leads just now, and are None if no
    way is free.
    """

    def __init__(self, *, config, clearance: float):
        """Args: config: an ExplorerConfig. clearance: from pylons' axes (m)."""
        self._config = config
        self._clearance = clearance

    def plan(self, now: Now, routes, through=()) -> FlatTrajectory | None:
        """Returns the leg along the first route that is free.

        Args:
            now: what is known.
            routes: lists of x, y, z and yaw.
            through: numbers of the gates that each has to pass.
        """
        start = self._start(now, 5)
        for route in routes:
            try:
                leg = plan_leg(
                    start,
                    np.array(route),
                    max_speed=self._config.max_speed,
                    max_acceleration=self._config.max_acceleration,
                )
            except TrajectoryOptimizationError:
                if np.linalg.norm(start[1, :3]) > _SLOW:
                    return None  # it is this moment's motion that does not fit
                continue
            if ways.is_clear(leg, now.gate_map, self._clearance, through):
                return leg
        return None

    def plan_through(self, now: Now, gates: list[GateEstimate]) -> FlatTrajectory | None:
        """Returns the leg through gates, at least one."""
        routes = ways.ways_through(
            self._start(now, 1)[0],
            gates,
            approach=self._config.approach_distance,
            beyond=self._config.passing_distance,
        )
        return self.plan(now, routes, [gate.number for gate in gates])

    def plan_home(self, now: Now, gates: list[GateEstimate]) -> FlatTrajectory | None:
        """Returns the leg through the gates still ahead, if any, and to over the start."""
        home, beyond = now.memory.home, self._config.passing_distance
        passing = [gate_pose(gate) for gate in gates]
        if gates:
            passing.append(gate_pose(gates[-1], beyond))
        # Up on the way out of the last gate, where nothing can stand.
        out = gate_pose(now.last, 2 * beyond)
        routes = [
            [*passing, home],
            [*passing, *ways.over_the_top(out, home)],
            [*passing, *ways.over_the_top(gate_pose(now.last, beyond), home)],
        ]
        return self.plan(now, routes, [gate.number for gate in gates])

    def plan_stop(self, now: Now) -> FlatTrajectory | None:
        """Returns the leg that stops soon."""
        pose, velocity = self._start(now, 2)
        return self.plan(now, [[pose + time * velocity] for time in _BRAKING_TIMES])

    def passing_times(self, leg: FlatTrajectory, gates: list[GateEstimate]) -> list:
        """Returns when on a leg from plan_through() or plan_home() gates are passed (s)."""
        times = {number: time for time, number, _ in ways.passages(*ways.positions(leg), gates)}
        return [times.get(gate.number, 0.0) for gate in gates]

    def is_good(self, now: Now, gates: list[GateEstimate]) -> bool:
        """Whether the rest of the present leg, through gates, is still free."""
        memory = now.memory
        return ways.is_clear(
            memory.leg,
            now.gate_map,
            self._clearance,
            [gate.number for gate in gates],
            now.time - memory.leg_start,
        )

    def _start(self, now: Now, count: int) -> np.ndarray:
        return now.memory.leg.derivatives(now.time - now.memory.leg_start, count)
