"""Plans every lap from the map as it then stands."""

import dataclasses as dc

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import EventStatus, LeafSystem

from airrace.common.immutable import Immutable
from airrace.scenario.limits import parse_limits
from airrace.systems.planning.lap_plan import NO_PLAN, LapPlan
from airrace.systems.planning.lap_planning import plan_lap
from airrace.systems.planning.laps import LapProblem
from airrace.systems.planning.map_margins import has_changed, largest_move, pylon_margins
from airrace.trajopt.flat_trajectory import unpack_flat_outputs
from airrace.trajopt.flight_limits import FlightLimits
from airrace.trajopt.reference import REFERENCE_SIZE
from airrace.vehicle import Vehicle

_RETRY_PERIOD = 1.0  # s, while there is no plan at all
_AMPLE = 1.5  # times as long as the search that took too long
_MOMENT = 1e-12  # s, that only rounding makes


@dc.dataclass(frozen=True, eq=False)
class _Memory(Immutable):
    """What the planner remembers.

    Attributes:
        plan: in force.
        pending: the one that will replace it, or None.
        job: the search for that one, if it goes on elsewhere, or None.
        latency: from the map to the plan in force (s), longer than declared after a
            search elsewhere took too long.
        tried_at: when the planner last looked for one (s).
        tried_lap: the lap at whose end that plan was to come into force.
        tried_gates: tuple of GateEstimate that it knew of.
        searched: the LapProblem that it last searched for a plan, or None.
    """

    plan: LapPlan = NO_PLAN
    pending: LapPlan | None = None
    job: object = None
    latency: float = 0.0
    tried_at: float = -np.inf
    tried_lap: int = 0
    tried_gates: tuple = ()
    searched: LapProblem | None = None


class LapPlanner(LeafSystem):
    """Section V of the Student AirRace report.

    .. pydrake_system::

        name: LapPlanner
        input_ports:
        - gate_map
        - explorer_status
        - exploration_reference
        output_ports:
        - lap_plan

    ``gate_map`` is a GateMap, ``explorer_status`` an ExplorerStatus,
    ``exploration_reference`` see trajopt/reference.py; ``lap_plan`` a
    LapPlan, NO_PLAN until the race begins.

    When the exploration is done, the planner takes the map and solves for a
    lap through the gates that the explorer found, in its order. It does so
    again in every lap, such that the plan, which comes into force one declared
    latency later, does so once the last gate has been passed, and goes on from
    the state that the old one has then. (Where plans are searched for elsewhere, one
    that comes too late is not flown, and the next is asked for earlier.) If there is
    no such plan, or it would be slower without need, the old one goes on, since a lap
    can be repeated, and nothing is searched for twice; before the first, the planner
    tries again when the map has changed.
    """

    def __init__(self, *, vehicle: Vehicle, trajectory: str, config, laps=np.inf, solve=plan_lap):
        """Constructs the planner.

        Args:
            vehicle: for its size and its rotors.
            trajectory: "3", "4", "6" or "optimal", see LapProblem.
            config: a PlannerConfig.
            laps: of the race; none is planned for after its end.
            solve: from a LapProblem to a LapPlan or None.

        Raises:
            TrajectoryOptimizationError: if the vehicle cannot hover within these limits.
        """
        LeafSystem.__init__(self)
        max_speed, max_acceleration = parse_limits(config.limits)
        self._fixed = dict(
            trajectory=trajectory,
            vehicle=vehicle,
            max_speed=max_speed,
            max_acceleration=max_acceleration,
            thrust_share=config.thrust_share,
        )
        FlightLimits(vehicle, thrust_share=config.thrust_share).check()
        self._laps = laps
        self._first_lap_move = config.first_lap_move
        self._solve = solve
        self._submit = None
        self._map = self.DeclareAbstractInputPort("gate_map", Value[object]())
        self._explorer = self.DeclareAbstractInputPort("explorer_status", Value[object]())
        self._reference = self.DeclareVectorInputPort("exploration_reference", REFERENCE_SIZE)
        self._memory = self.DeclareAbstractState(Value[object](_Memory(latency=config.latency)))
        self._period = 1.0 / config.rate
        self.DeclarePeriodicUnrestrictedUpdateEvent(self._period, 0.0, self._update)
        # Plans come into force on time, whether or not that is a tick, by an event: the
        # controller asks for the plan far more often than it changes.
        self._lag = config.latency % self._period
        if min(self._lag, self._period - self._lag) < _MOMENT:
            self._lag = 0.0
        else:
            self.DeclarePeriodicUnrestrictedUpdateEvent(self._period, self._lag, self._switch)
        self.DeclareAbstractOutputPort(
            "lap_plan",
            lambda: Value[object](NO_PLAN),
            lambda context, output: output.set_value(self._recall(context).plan),
            {self.abstract_state_ticket(self._memory)},
        )

    def solve_elsewhere(self, submit) -> None:
        """From now on, plans are searched for while everything else goes on.

        Args:
            submit: from a LapProblem to a job: see PlanningWorker.
        """
        self._submit = submit

    def _recall(self, context) -> _Memory:
        return context.get_abstract_state(int(self._memory)).get_value()

    def _in_force_from(self, memory: _Memory, now) -> float:
        """Returns when a plan that is searched for now comes into force (s)."""
        periods = np.ceil((now + memory.latency - self._lag) / self._period - 1e-6)
        return float(periods * self._period + self._lag)

    def _switch(self, context, state):
        memory = self._recall(context)
        return self._remember(state, memory, _switched(memory, context.get_time()))

    def _update(self, context, state):
        memory, now = self._recall(context), context.get_time()
        after = self._next(context, memory, now)
        return self._remember(state, memory, _switched(after, now))

    def _remember(self, state, before: _Memory, after: _Memory) -> EventStatus:
        if after is before:
            # So that nothing in the whole race need be computed anew.
            return EventStatus.DidNothing()
        state.get_mutable_abstract_state(int(self._memory)).set_value(after)
        return EventStatus.Succeeded()

    def _next(self, context, memory: _Memory, now: float) -> _Memory:
        """Returns the memory of the next tick, but for a plan whose time has come."""
        if memory.pending is not None:
            return memory
        if memory.job is not None:
            if not memory.job.done():
                return memory
            found = memory.job.result()
            plan = _in_time(found, now)
            after = dc.replace(memory, job=None, pending=plan)
            if found is not None and plan is None:
                # What was found is not flown, so that it is worth another search.
                after = dc.replace(after, latency=_AMPLE * (now - memory.tried_at), searched=None)
            return after
        if not self._is_time(context, memory, now):
            return memory
        start_time = self._in_force_from(memory, now)
        problem = self._Problem(context, memory, start_time)
        if problem is not None and _is_known(problem, memory.searched):
            problem = None
        elsewhere = problem is not None and self._submit is not None
        return dc.replace(
            memory,
            pending=None if problem is None or elsewhere else self._solve(problem),
            job=self._submit(problem) if elsewhere else None,
            tried_at=now,
            tried_lap=0 if memory.plan is NO_PLAN else memory.plan.lap_at(start_time),
            tried_gates=self._map.Eval(context).gates,
            searched=problem or memory.searched,
        )

    def _is_time(self, context, memory: _Memory, now) -> bool:
        """Whether to look for a plan now.

        With a plan that is once a lap, when the new one would come into force
        between the last gate and gate 1. An entry counts to the lap before,
        which has been tried, and nothing comes after the race.
        """
        if memory.plan is NO_PLAN:
            if not self._explorer.Eval(context).done:
                return False
            # What failed once would again, unless the map has changed.
            waited = now >= memory.tried_at + _RETRY_PERIOD - 1e-9
            gates = self._map.Eval(context).gates
            first = not np.isfinite(memory.tried_at)
            return waited and (first or has_changed(gates, memory.tried_gates))
        plan, start_time = memory.plan, self._in_force_from(memory, now)
        last_leg = plan.circuit.duration - plan.circuit.gate_times[-2]
        return (
            plan.next_start(start_time) - start_time <= last_leg + 1e-9
            and memory.tried_lap < plan.lap_at(start_time) < self._laps
        )

    def _Problem(self, context, memory: _Memory, start_time) -> LapProblem | None:
        """Returns what to solve for the plan from a time on, None if a gate is not known."""
        old, gate_map = memory.plan, self._map.Eval(context)
        known = {gate.number: gate for gate in gate_map.gates}
        found = self._explorer.Eval(context).gates
        if not set(found) <= set(known):
            return None
        if old is NO_PLAN:
            start = unpack_flat_outputs(self._reference.Eval(context))
        else:
            start = old.derivatives(start_time)
        # The gates to fly through first, then all others to keep clear of.
        gates = tuple(known.pop(number) for number in found)
        every = (*gates, *known.values())
        # Until a lap has shown whether gates move, and how far, they may have.
        moved = self._first_lap_move if old is NO_PLAN else largest_move(every, memory.tried_gates)
        return LapProblem(
            **self._fixed,
            gates=gates,
            pylons=np.array([gate.pylons for gate in every]).reshape(-1, 2),
            margins=pylon_margins(every, gate_map.markers, moved),
            start_time=start_time,
            start=start,
            old=None if old is NO_PLAN else old,
        )


def _is_known(problem: LapProblem, last: LapProblem | None) -> bool:
    """Whether the search before was for the same lap, and from a lap already.

    Once more, it would bring a few hundredths of a percent.
    """
    return last is not None and last.old is not None and last.has_same_lap(problem)


def _switched(memory: _Memory, now: float) -> _Memory:
    """Returns the memory with the pending plan in force, if its time has come."""
    if memory.pending is None or now < memory.pending.start_time - 1e-9:
        return memory
    return dc.replace(memory, plan=memory.pending, pending=None)


def _in_time(plan: LapPlan | None, now: float) -> LapPlan | None:
    """Returns a plan that was found elsewhere, if it can still be flown, or None.

    The first starts at rest, so whenever it is there; a later one goes on from the
    state that the drone has at its start.
    """
    if plan is None or plan.start_time >= now:
        return plan
    return dc.replace(plan, start_time=now) if plan.lap == 1 else None
