"""Plans the explorer's legs, and checks them as the map grows."""

from collections.abc import Iterable, Sequence

import numpy as np

from airrace.scenario import ExplorerConfig
from airrace.systems.exploring import clear_paths
from airrace.systems.exploring.exploration import gate_pose
from airrace.systems.exploring.explorer_memory import Situation
from airrace.track.gate_map import GateEstimate
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.min_snap.leg import plan_leg

_SLOW = 1.0  # m/s
_NEAR = 18.0  # m, before a gate: both its markers are in the picture, and seen exactly
_BRAKING_TIMES = (0.7, 1.0, 0.5, 1.5)  # s, at the present velocity: to where it stops


class LegPlanner:
    """Plans legs that are clear of everything known.

    All legs continue the motion of the present one, and are None if no route is clear.
    """

    def __init__(self, *, config: ExplorerConfig, clearance: float):
        """Args: config: an ExplorerConfig. clearance: from pylons' axes (m)."""
        self._config = config
        self._clearance = clearance

    def plan(
        self, now: Situation, routes: Iterable[list], through: Sequence[int] = ()
    ) -> FlatTrajectory | None:
        """Returns the leg along the first route that is clear.

        Args:
            now: what is known.
            routes: lists of waypoints x, y, z and yaw.
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
                    return None  # other routes fail as well: the present motion is the reason
                continue
            if clear_paths.is_clear(leg, now.gate_map, self._clearance, through):
                return leg
        return None

    def plan_through(self, now: Situation, gates: list[GateEstimate]) -> FlatTrajectory | None:
        """Returns the leg through gates, at least one."""
        routes = clear_paths.routes_through(
            self._start(now, 1)[0],
            gates,
            approach=self._config.approach_distance,
            beyond=self._config.passing_distance,
        )
        return self.plan(now, routes, [gate.number for gate in gates])

    def plan_home(
        self, now: Situation, gates: list[GateEstimate], look_at: GateEstimate | None = None
    ) -> FlatTrajectory | None:
        """Returns the leg through the gates still ahead, if any, to the hover over the start.

        Args:
            now: what is known.
            gates: to pass.
            look_at: a gate to see from near on the way, if there is a clear leg that does.
        """
        home, beyond = now.memory.home, self._config.passing_distance
        passing = [gate_pose(gate) for gate in gates]
        if gates:
            passing.append(gate_pose(gates[-1], beyond))
        if look_at is not None:
            near = gate_pose(look_at, -_NEAR)
            gap = (near[:3] - passing[-1][:3]) @ look_at.forward
            seeing = [*passing, near] if gap > 0.0 else passing
            over = clear_paths.route_above_pylons(seeing[-1], home)
            leg = self.plan(now, [[*seeing, *over]], [gate.number for gate in gates])
            if leg is not None:
                return leg
        # Climb right behind the last gate, where no pylon can stand.
        assert now.last is not None  # there is no way home from a track without gates
        out = gate_pose(now.last, 2 * beyond)
        routes = [
            [*passing, home],
            [*passing, *clear_paths.route_above_pylons(out, home)],
            [*passing, *clear_paths.route_above_pylons(gate_pose(now.last, beyond), home)],
        ]
        return self.plan(now, routes, [gate.number for gate in gates])

    def plan_stop(self, now: Situation) -> FlatTrajectory | None:
        """Returns the leg that brakes to a stop."""
        pose, velocity = self._start(now, 2)
        return self.plan(now, [[pose + time * velocity] for time in _BRAKING_TIMES])

    def passing_times(self, leg: FlatTrajectory, gates: list[GateEstimate]) -> list:
        """Returns when on a leg from plan_through() or plan_home() gates are passed (s)."""
        times = {
            number: time
            for time, number, _ in clear_paths.gate_crossings(*clear_paths.positions(leg), gates)
        }
        return [times.get(gate.number, 0.0) for gate in gates]

    def is_clear(self, now: Situation, gates: list[GateEstimate]) -> bool:
        """Whether the rest of the present leg, through gates, is still clear."""
        memory = now.memory
        return clear_paths.is_clear(
            memory.leg,
            now.gate_map,
            self._clearance,
            [gate.number for gate in gates],
            now.time - memory.leg_start,
        )

    def _start(self, now: Situation, count: int) -> np.ndarray:
        return now.memory.leg.derivatives(now.time - now.memory.leg_start, count)
