"""When laps are planned, from the map as it then stands, and when plans come into force."""

import dataclasses as dc
from collections.abc import Callable
from typing import Any, Self

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, EventStatus, State

from airrace.common.errors import UserError
from airrace.common.immutable import Immutable
from airrace.scenario import BETAFLIGHT, INTERNAL, TRUTH, PlannerConfig, Scenario
from airrace.scenario.lap_limits import parse_limits
from airrace.systems.contract import check_arguments, name_of
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.planning.known_drone import expecting_drag, in_steps, known_limits
from airrace.systems.planning.lap_plan import NO_PLAN, LapPlan
from airrace.systems.planning.lap_planning import plan_lap
from airrace.systems.planning.laps import LapProblem, PlanRequest
from airrace.systems.planning.map_margins import (
    CONTROLLER,
    UNKNOWN_SQUARE,
    has_changed,
    largest_move,
    pylon_margins,
    tracking_margins,
)
from airrace.systems.planning.path_clock import CLOCK_SIZE, REGULAR_VECTOR, PathClock, as_clock
from airrace.systems.planning.plan_checks import check_plan
from airrace.systems.ports import read_or, read_vector
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.flat_trajectory import unpack_flat_outputs
from airrace.trajopt.flight_limits import FlightLimits
from airrace.trajopt.min_snap.circuit import LapStyle
from airrace.trajopt.reference import REFERENCE_SIZE
from airrace.vehicle import GRAVITY, Vehicle, load_vehicle
from airrace.vehicle.air import AIR_SIZE, STILL_VECTOR
from airrace.vehicle.state import STATE_SIZE, as_state

_RETRY_PERIOD = 1.0  # s, while there is no plan at all
_LATENCY_FACTOR = 1.5  # of the time of a search that took too long
_ROUNDING = 1e-12  # s
_NEAREST = 0.15  # m, that a drone which follows well comes to boards, within the rotors' limits
_HOVERING = 0.98  # of what laps may take, with which a drone must hover at least
_SLOW = 0.1  # m/s, below which a path has no direction
_GATES = 256  # at which the error of the position is known
_FADES = 0.5  # s near a gate, after which older errors there are forgotten to 1 / e
_ON_THE_SPOT = {"CALIBRATE", "TAKE_OFF", "HOVER", "DONE"}  # states of an explorer that only hovers
# rad/s, of plans: rotors take a tenth of a second from rest to their limit. In a quicker turn the
# drone falls behind, and where the rotors are at their limits it stays there.
_MAX_RATE = 12.0


@dc.dataclass(frozen=True, eq=False)
class _Memory(Immutable):
    """The state of the planner."""

    plan: LapPlan = NO_PLAN  #: in force
    pending: LapPlan | None = None  #: the plan that will replace it, or None
    job: Any = None  #: the search for that plan in another process, or None
    #: From the map to the plan in force (s); longer than declared after a search in another process
    #: took too long.
    latency: float = 0.0
    tried_at: float = -np.inf  #: when the last search began (s)
    tried_lap: int = 0  #: the lap at whose end its plan was to come into force
    tried_gates: tuple = ()  #: tuple of GateEstimate of the map that it was given
    searched: LapProblem | None = None  #: the LapProblem of the last search, or None


class LapPlanner(LeafSystem):
    """Plans the first lap when the exploration is done, and each next lap in flight.

    .. pydrake_system::

        name: LapPlanner
        input_ports:
        - gate_map
        - explorer_status
        - exploration_reference
        - policy_status (may be left open: nobody else flies)
        - filtered_estimate (may be left open: how plans are followed is not known)
        - path_clock (may be left open: plans never wait)
        - rotor_factors (may be left open: the drone is as in its file)
        - air (may be left open: there is no drag)
        output_ports:
        - lap_plan

    ``gate_map`` is a GateMap, ``explorer_status`` an ExplorerStatus,
    ``exploration_reference`` see trajopt/reference.py; ``lap_plan`` a
    LapPlan, NO_PLAN until the race begins.

    **When is a lap planned?** The first, when the exploration is done, through the gates that
    the explorer found, in its order (Section V of the Student AirRace paper). The next ones
    once a lap each, so late that the map is fresh, and so early that the plan is in force
    when the last gate has been passed. None is planned for after the end of the race.

    **When does a plan come into force?** One declared latency after its map was taken, by the clock
    of plans, which may wait for the drone: see PathGovernor. It
    continues from the state that the old plan has at that time. A plan from another process
    that comes too late is not flown; the next one is asked for earlier.

    **When is there no new plan?** If the search finds none, or refuses it since the old plan is
    no slower (see plan_lap()), or if the same problem was solved before. Then the old lap is
    flown again. Before the first plan, the search is repeated when the map has changed. With the
    scenario's ``update: always``, nothing is refused: each lap that a plan is found for has
    one of its own.

    **And with a PolicyController?** Then the first lap is planned, if at all, when that has handed
    back, as ``policy_status`` says, a PolicyStatus, and from where the drone hovers then.

    **And if nothing is known of the air?** A drone that was given its map has only hovered. If the
    rotors are all that limits its laps, the first counts with ``first_lap_drag``, a share of the
    drag in the drone's file, and keeps thrust for as much again.

    **With which margin?** See pylon_margins(): until a lap has shown how far gates move, they
    count as moving by the scenario's ``first_lap_move``. Near each gate, the planner notes how far
    the drone is to the side of its plan, by ``filtered_estimate``, a vehicle.State (14). Where that
    is little, the next plan comes nearer to the boards, down to ``least_margin``; where it is much,
    it keeps farther away.
    """

    def __init__(
        self,
        *,
        vehicle: Vehicle,
        trajectory: str,
        config: PlannerConfig,
        laps: float = np.inf,
        solve: Callable[[LapProblem], LapPlan | None] = plan_lap,
        least_margin: float | None = CONTROLLER,
    ):
        """Constructs the planner.

        Args:
            vehicle: for its size and its rotors.
            trajectory: "3", "4", "6" or "optimal", see LapProblem.
            config: a PlannerConfig.
            laps: of the race; none is planned for after its end.
            solve: a function from a LapProblem to a LapPlan or None.
            least_margin: from boards (m), however well the drone follows its plans; None: margins
                are the same however it does.

        Raises:
            TrajectoryOptimizationError: if the vehicle cannot hover within these limits.
            UserError: if solve takes other arguments.
        """
        LeafSystem.__init__(self)
        check_arguments(solve, "problem")
        check_arguments(self.solve, "problem")  # of a class of one's own
        max_speed, max_acceleration = parse_limits(config.limits)
        self._limits = FlightLimits(
            vehicle,
            thrust_share=config.thrust_share or 1.0,
            max_speed=max_speed,
            max_acceleration=max_acceleration,
            max_rate=_MAX_RATE,
        )
        self._limits.scaled(_HOVERING).check()
        self._trajectory = trajectory
        self._laps = laps
        self._first_lap_move, self._first_lap_drag = config.first_lap_move, config.first_lap_drag
        self._style = LapStyle(
            rests=config.lap == "rest_to_rest", soft=config.time_allocation == "original"
        )
        self._least_margin = least_margin
        self._always = config.update == "always"
        self._solve = solve
        self._submit: Callable | None = None
        self._map = self.DeclareAbstractInputPort("gate_map", Value[object]())
        self._explorer = self.DeclareAbstractInputPort("explorer_status", Value[object]())
        self._reference = self.DeclareVectorInputPort("exploration_reference", REFERENCE_SIZE)
        self._policy = self.DeclareAbstractInputPort("policy_status", Value[object]())
        self._factors = self.DeclareVectorInputPort("rotor_factors", len(vehicle.rotors))
        self._air = self.DeclareVectorInputPort("air", AIR_SIZE)
        self._clock = self.DeclareVectorInputPort("path_clock", CLOCK_SIZE)
        self._estimate = self.DeclareVectorInputPort("filtered_estimate", STATE_SIZE)
        # Mean squares of the error of the position across the path near each gate (m^2).
        self._squares = self.DeclareDiscreteState(np.full(_GATES, UNKNOWN_SQUARE))
        self._memory = self.DeclareAbstractState(Value[object](_Memory(latency=config.latency)))
        self._period = 1.0 / config.rate
        self.DeclarePeriodicUnrestrictedUpdateEvent(self._period, 0.0, self._update)
        self.DeclarePeriodicDiscreteUpdateEvent(self._period, 0.0, self._note_error)
        # Plans come into force by an event of their own, if not at a tick: the output is evaluated
        # far more often than it changes.
        self._offset = config.latency % self._period
        if min(self._offset, self._period - self._offset) < _ROUNDING:
            self._offset = 0.0
        else:
            self.DeclarePeriodicUnrestrictedUpdateEvent(self._period, self._offset, self._switch)
        self.DeclareAbstractOutputPort(
            "lap_plan",
            lambda: Value[object](NO_PLAN),
            lambda context, output: output.set_value(self._recall(context).plan),
            {self.abstract_state_ticket(self._memory)},
        )

    @classmethod
    def from_scenario(
        cls, scenario: Scenario, solve: Callable[[LapProblem], LapPlan | None] = plan_lap
    ) -> Self:
        """Returns the planner of a scenario; solve: see the constructor.

        Raises:
            UserError: if the drone cannot hover within the limits.
        """
        vehicle, _ = load_vehicle(scenario.drone)
        config = _config_of(scenario, vehicle)
        try:
            return cls(
                vehicle=vehicle,
                trajectory=scenario.trajectory,
                config=config,
                laps=scenario.laps,
                solve=solve,
                least_margin=_least_margin(scenario),
            )
        except TrajectoryOptimizationError as e:
            remedy = "Raise planner.thrust_share."
            if config.thrust_share in (None, 1.0):
                remedy = "Change the drone's rotors, or its mass."
            raise UserError(f"The lap planner cannot be: {e} {remedy}") from None

    def solve(self, problem: LapProblem) -> LapPlan | None:
        """Returns the plan for a problem, or None: see plan_lap(), or what was given.

        Raises:
            UserError: if the function that was given returned anything else.
        """
        plan = self._solve(problem)
        if plan is not None and self._solve is not plan_lap:
            check_plan(f"{name_of(self._solve)}()", plan)
        return plan

    def solve_elsewhere(self, submit: Callable) -> None:
        """From now on, submit makes a job of a LapProblem: see PlanningWorker."""
        self._submit = submit

    def _recall(self, context: Context) -> _Memory:
        return context.get_abstract_state(int(self._memory)).get_value()

    def _path_clock(self, context: Context) -> PathClock:
        return as_clock(read_or(REGULAR_VECTOR, self._clock, context))

    def _delay(self, context: Context) -> float:
        """Returns how far the clock of plans is behind (s); all times below are by that clock."""
        return self._path_clock(context).delay

    def _in_force_from(self, context: Context, latency: float) -> float:
        """Returns when a plan that is searched for now comes into force (s): at an event."""
        due = context.get_time() + latency - self._offset
        periods = np.ceil(due / self._period - 1e-6)
        return float(periods * self._period + self._offset) - self._delay(context)

    def _switch(self, context, state):
        memory, now = self._recall(context), context.get_time() - self._delay(context)
        return self._remember(state, memory, _switched(memory, now))

    def _update(self, context, state):
        memory, now = self._recall(context), context.get_time() - self._delay(context)
        after = self._next(context, memory, now)
        return self._remember(state, memory, _switched(after, now))

    def _note_error(self, context, discrete_state):
        """Notes how far the drone is to the side of the plan in force, near which gate."""
        plan, now = self._recall(context).plan, context.get_time()
        if plan is NO_PLAN or self._least_margin is None or not self._estimate.HasValue(context):
            return
        clock = self._path_clock(context)
        position = as_state(read_vector(self._estimate, context)).position
        reference = clock.reference(plan, now)
        error, velocity = reference[:3] - position, reference[3:6]
        # Who is early or late on a path comes no nearer to boards.
        error = error - (error @ velocity) / max(velocity @ velocity, _SLOW**2) * velocity
        gate = plan.nearest_gate(now - clock.after(now).delay)
        if np.isfinite(error).all() and gate < _GATES:
            squares = discrete_state.get_mutable_value(int(self._squares))
            squares[gate] += min(self._period / _FADES, 1.0) * (error @ error - squares[gate])

    def _remember(self, state: State, before: _Memory, after: _Memory) -> EventStatus:
        if after is before:
            # An update would make Drake compute all outputs of the race anew.
            return EventStatus.DidNothing()
        state.get_mutable_abstract_state(int(self._memory)).set_value(after)
        return EventStatus.Succeeded()

    def _next(self, context: Context, memory: _Memory, now: float) -> _Memory:
        """Returns the memory after a tick, whose pending plan may be due."""
        if memory.pending is not None:
            return memory
        if memory.job is not None:
            if not memory.job.done():
                return memory
            plan, after = memory.job.result(), dc.replace(memory, job=None)
            if plan is None or plan.start_time >= now:
                return dc.replace(after, pending=plan)
            if plan.lap == 1:  # it starts from hover, at any time
                return dc.replace(after, pending=dc.replace(plan, start_time=now))
            # The drone is elsewhere by now: the problem is to be solved again, and earlier.
            latency = _LATENCY_FACTOR * (now - memory.tried_at)
            return dc.replace(after, latency=latency, searched=None)
        if not self._is_due(context, memory, now):
            return memory
        start_time = self._in_force_from(context, memory.latency)
        problem = self._make_problem(context, memory, start_time)
        last = None if self._always else memory.searched
        if problem and last and last.old is not NO_PLAN and last.has_same_lap(problem):
            # Another search would make the lap a few hundredths of a percent quicker.
            problem = None
        pending = job = None
        if problem is not None and self._submit is not None:
            job = self._submit(problem)
        elif problem is not None:
            pending = self.solve(problem)
        return dc.replace(
            memory,
            pending=pending,
            job=job,
            tried_at=now,
            tried_lap=0 if memory.plan is NO_PLAN else memory.plan.lap_at(start_time),
            tried_gates=self._map.Eval(context).gates,
            searched=problem or memory.searched,
        )

    def _is_due(self, context: Context, memory: _Memory, now: float) -> bool:
        """Whether to search for a plan now.

        If there is a plan, that is once a lap, as soon as the new one would come into force
        between the last gate and gate 1. A transition counts to the lap before.
        """
        if memory.plan is NO_PLAN:
            if not self._explorer.Eval(context).done:
                return False
            policy = self._policy
            if policy.HasValue(context) and not policy.Eval(context).planner_may_plan:
                return False
            # The same map would give no plan again.
            waited = now >= memory.tried_at + _RETRY_PERIOD - 1e-9
            gates = self._map.Eval(context).gates
            first = not np.isfinite(memory.tried_at)
            return waited and (first or has_changed(gates, memory.tried_gates))
        plan, start_time = memory.plan, self._in_force_from(context, memory.latency)
        last_leg = plan.circuit.duration - plan.circuit.gate_times[-2]
        return (
            plan.next_start(start_time) - start_time <= last_leg + 1e-9
            and memory.tried_lap < plan.lap_at(start_time) < self._laps
        )

    def _make_problem(
        self, context: Context, memory: _Memory, start_time: float
    ) -> LapProblem | None:
        """Returns the problem of a plan from a time on; None if a gate is not on the map."""
        old, gate_map = memory.plan, self._map.Eval(context)
        known = {gate.number: gate for gate in gate_map.gates}
        found = self._explorer.Eval(context).gates
        if not set(found) <= set(known):
            return None
        # The gates to fly through first, then all others to keep clear of.
        gates = tuple(known.pop(number) for number in found)
        every = (*gates, *known.values())
        if old is NO_PLAN:
            moved = self._first_lap_move
            start = unpack_flat_outputs(self._reference.Eval(context))
        else:
            moved = largest_move(every, memory.tried_gates)
            start = old.derivatives(start_time)
        squares = context.get_discrete_state(self._squares).value()
        tracking = np.full(len(every), CONTROLLER)
        followed = min(len(gates), _GATES)
        tracking[:followed] = tracking_margins(squares[:followed], self._least_margin or CONTROLLER)
        factors = read_or(np.ones(len(self._limits.vehicle.rotors)), self._factors, context)
        air = read_or(STILL_VECTOR, self._air, context)
        if old is NO_PLAN and self._expects_drag(context):
            factors, air = expecting_drag(factors, self._limits.vehicle, self._first_lap_drag)
        factors, air = in_steps(factors, air)
        problem = self.problem_of(
            PlanRequest(
                start_time=start_time,
                gates=gates,
                pylons=np.array([gate.pylons for gate in every]).reshape(-1, 2),
                margins=pylon_margins(every, gate_map.markers, moved, tracking),
                start=start,
                old=old,
                rotor_factors=factors,
                air=air,
            )
        )
        return problem.from_where_it_is_easy(self._period)

    def _expects_drag(self, context: Context) -> bool:
        """Whether a drone that has only hovered is to fly as fast as its rotors can."""
        limits, states = self._limits, {e.state for e in self._explorer.Eval(context).events}
        asked = np.hypot(limits.max_acceleration, GRAVITY)
        is_limit = states <= _ON_THE_SPOT and asked > limits.max_specific_force
        return is_limit and self._first_lap_drag > 0.0

    def problem_of(self, request: PlanRequest) -> LapProblem:
        """Returns the problem that this planner makes of what is new."""
        return LapProblem(
            **request._asdict(),
            trajectory=self._trajectory,
            limits=known_limits(self._limits, request.rotor_factors, request.air),
            style=self._style,
            always=self._always,
        )


def _config_of(scenario: Scenario, vehicle: Vehicle) -> PlannerConfig:
    """Returns how laps are planned; Betaflight's mixer needs thrust that no plan takes."""
    share = scenario.planner.thrust_share
    if share is None and scenario.flight_controller == BETAFLIGHT:
        share = vehicle.betaflight_share
    return dc.replace(scenario.planner, thrust_share=share)


def _least_margin(scenario: Scenario) -> float | None:
    """Returns how near to boards plans of a scenario come, if the drone follows well (m).

    How far an estimate of one's own is off, no error of tracking shows. And within other limits
    than the rotors' it is not tracking that makes a lap slow. A flight controller follows the same
    lap better each time than a new one, so its margins stay: None.
    """
    if scenario.flight_controller != INTERNAL:
        return None
    is_sure = scenario.estimator == TRUTH and scenario.planner.limits == "rotor"
    return _NEAREST if is_sure else CONTROLLER


def _switched(memory: _Memory, now: float) -> _Memory:
    """Returns the memory with the pending plan in force, if its time has come."""
    if memory.pending is None or now < memory.pending.start_time - 1e-9:
        return memory
    return dc.replace(memory, plan=memory.pending, pending=None)
