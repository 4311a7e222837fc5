"""Plans every lap from the map as it then stands."""

import dataclasses as dc
import time as wall_clock

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import LeafSystem

from airrace.immutable import Immutable
from airrace.systems.lap_plan import NO_PLAN, LapPlan, PlanReport
from airrace.trajopt.circuit import Circuit, plan_circuit
from airrace.trajopt.entry import plan_change, plan_start
from airrace.trajopt.flat_trajectory import SIZE, FlatTrajectory, unpack_flat_outputs
from airrace.trajopt.flatness import rotor_thrusts
from airrace.trajopt.flight_limits import FlightLimits
from airrace.trajopt.flyable import clearance_of, peaks, sample_times
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.min_snap import TrajectoryOptimizationError
from airrace.trajopt.time_optimal import plan_optimal_circuit
from airrace.vehicle import GRAVITY, Vehicle

_RETRY_PERIOD = 1.0  # s, while there is no plan at all
_MARGIN = 0.99  # of the limits, so that a slightly different way onto the lap keeps them
_THRUST_SHARE = 0.85  # of the rotors' limits: the rest is for the controller
_HALF_HEIGHT = 2.5  # m, above and below a gate's midpoint


@dc.dataclass(frozen=True, eq=False)
class _Memory(Immutable):
    """What the planner remembers.

    Attributes:
        plan: in force.
        pending: the one that will replace it, or None.
        tried_at: when the planner last looked for one (s).
        tried_lap: the lap at whose end that plan was to come into force.
    """

    plan: LapPlan = NO_PLAN
    pending: LapPlan | None = None
    tried_at: float = -np.inf
    tried_lap: int = 0


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
    ``exploration_reference`` see trajopt/flat_trajectory.py; ``lap_plan`` a
    LapPlan, NO_PLAN until the race begins.

    When the exploration is done, the planner takes the map and solves for a
    lap through the gates that the explorer found, in its order. It does so
    again in every lap, such that the plan, which comes into force one declared
    latency later, does so once the last gate has been passed, and goes on from
    the state that the old one has then. If there is no such plan, the old one
    goes on, since a lap can be repeated; before the first, the planner tries
    again.
    """

    def __init__(self, *, vehicle: Vehicle, dimensions: int | None, config):
        """Constructs the planner.

        Args:
            vehicle: for its size and the check of the rotor thrusts.
            dimensions: 3, 4 or 6, see plan_circuit; None for the quickest laps, see
                plan_optimal_circuit.
            config: a PlannerConfig.
        """
        LeafSystem.__init__(self)
        self._vehicle = vehicle
        self._dimensions = dimensions
        self._latency = config.latency
        self._limits = dict(
            clearance=clearance_of(vehicle.radius),
            max_speed=config.max_speed,
            max_acceleration=config.max_acceleration,
        )
        self._map = self.DeclareAbstractInputPort("gate_map", Value[object]())
        self._explorer = self.DeclareAbstractInputPort("explorer_status", Value[object]())
        self._reference = self.DeclareVectorInputPort("exploration_reference", SIZE)
        self._memory = self.DeclareAbstractState(Value[object](_Memory()))
        self.DeclarePeriodicUnrestrictedUpdateEvent(1.0 / config.rate, 0.0, self._Update)
        self.DeclareAbstractOutputPort(
            "lap_plan",
            lambda: Value[object](NO_PLAN),
            self._CalcPlan,
            {self.abstract_state_ticket(self._memory), self.time_ticket()},
        )

    def _Recall(self, context) -> _Memory:
        return context.get_abstract_state(int(self._memory)).get_value()

    def _CalcPlan(self, context, output):
        # A plan comes into force on time, whether or not that is a tick.
        memory = self._Recall(context)
        in_force = memory.pending is not None and _is_due(memory.pending, context)
        output.set_value(memory.pending if in_force else memory.plan)

    def _Update(self, context, state):
        memory = self._Recall(context)
        now = context.get_time()
        if memory.pending is not None:
            if not _is_due(memory.pending, context):
                return
            after = dc.replace(memory, plan=memory.pending, pending=None)
        elif self._IsTime(context, memory, now):
            start_time = now + self._latency
            after = dc.replace(
                memory,
                pending=self._Plan(context, memory.plan, start_time),
                tried_at=now,
                tried_lap=0 if memory.plan is NO_PLAN else memory.plan.lap_at(start_time),
            )
        else:
            return
        state.get_mutable_abstract_state(int(self._memory)).set_value(after)

    def _IsTime(self, context, memory: _Memory, now) -> bool:
        """Whether to look for a plan now.

        With a plan that is once a lap, when the new one would come into force
        between the last gate and gate 1. An entry counts to the lap before,
        which has been tried.
        """
        if memory.plan is NO_PLAN:
            done = self._explorer.Eval(context).done
            return done and now >= memory.tried_at + _RETRY_PERIOD - 1e-9
        plan, start_time = memory.plan, now + self._latency
        last_leg = plan.circuit.duration - plan.circuit.gate_times[-2]
        return (
            plan.next_start(start_time) - start_time <= last_leg + 1e-9
            and plan.lap_at(start_time) > memory.tried_lap
        )

    def _Plan(self, context, old: LapPlan, start_time) -> LapPlan | None:
        """Returns the plan from a time on, or None if there is none."""
        clock = wall_clock.perf_counter()
        known = {gate.number: gate for gate in self._map.Eval(context).gates}
        found = self._explorer.Eval(context).gates
        if not set(found) <= set(known):
            return None
        gates = [known[number] for number in found]
        pylons = np.array([gate.pylons for gate in known.values()]).reshape(-1, 2)
        try:
            circuit = self._PlanCircuit(gates, pylons, old.circuit)
            if old is NO_PLAN:
                start = unpack_flat_outputs(self._reference.Eval(context))
                lap = 1
                entry, phase = plan_start(
                    start, circuit, self._dimensions or 4, pylons, **self._limits
                )
            else:
                lap = old.lap_at(start_time) + 1
                remaining = old.next_start(start_time) - start_time
                entry, phase = plan_change(
                    old.derivatives(start_time), circuit, remaining, pylons, **self._limits
                ), 0.0
        except TrajectoryOptimizationError:
            return None
        report = self._Check(entry, circuit, wall_clock.perf_counter() - clock)
        return LapPlan(
            lap=lap, start_time=start_time, entry=entry, circuit=circuit, phase=phase,
            report=report,
        )

    def _PlanCircuit(self, gates, pylons, previous: Circuit | None) -> Circuit:
        midpoints, headings = [g.p_WG for g in gates], [g.heading for g in gates]
        if self._dimensions is not None:
            return plan_circuit(
                midpoints, headings, pylons, self._dimensions, previous=previous, **self._limits
            )
        clearance = self._limits["clearance"]
        limits = FlightLimits(
            self._vehicle, thrust_share=_THRUST_SHARE,
            max_speed=_MARGIN * self._limits["max_speed"],
            max_acceleration=_MARGIN * self._limits["max_acceleration"],
        )
        return plan_optimal_circuit(
            GateRegions.windows(
                midpoints, headings, [g.spacing / 2 - clearance for g in gates], _HALF_HEIGHT
            ),
            pylons, limits, clearance=clearance, previous=previous,
        )

    def _Check(self, entry: FlatTrajectory, circuit: FlatTrajectory, solve_time) -> PlanReport:
        samples = np.hstack([
            trajectory.sample(sample_times(trajectory)) for trajectory in (entry, circuit)
        ])
        speed, acceleration = peaks(samples)
        return PlanReport(
            solve_time=solve_time,
            duration=circuit.duration,
            max_speed=speed,
            max_acceleration=acceleration,
            max_rotor_thrust=float(rotor_thrusts(samples, self._vehicle, GRAVITY).max()),
        )


def _is_due(plan: LapPlan, context) -> bool:
    return context.get_time() >= plan.start_time - 1e-9
