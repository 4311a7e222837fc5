"""Flies laps by a network, from the filtered estimate and the map."""

import functools
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context

from airrace.common.errors import UserError
from airrace.common.jit import all_finite
from airrace.common.packing import Packing
from airrace.common.resources import models_path
from airrace.math.quaternion import reference_yaw
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.policy.command_scale import ctbr_scale, scaled
from airrace.systems.policy.gates_observation import map_openings, write_gates_observation
from airrace.systems.policy.policy_network import ACTIONS, PolicyNetwork, load_policy
from airrace.systems.types import LAND, ExplorerStatus, PolicyStatus
from airrace.track.gate_map import GateMap
from airrace.track.gate_opening import OPENING_SIZE, as_opening, find
from airrace.trajopt.reference import REFERENCE_SIZE, Reference, reference_vector
from airrace.trajopt.stop import Stop
from airrace.vehicle import GRAVITY, Vehicle, load_vehicle
from airrace.vehicle.state import STATE_SIZE, State, as_state, state_vector

if TYPE_CHECKING:  # else an edit of it would have all machine code compiled anew
    from airrace.scenario import Scenario

PERIOD = 0.02  # s, between two actions, as in the environment
_PATIENCE = 5  # observations in a row that are not known, before it hands back
_STILL = 0.5  # m/s, of a hover
_LONGEST_WAIT = 3.0  # s, until a drone that is ready to race is also fit for the network
_LEAST_HEIGHT = 3.0  # m, at which it stops
_REST = 1.0  # s, after it has stopped, before a lap is planned
# Where it is in the race.
WAITING, FLYING, HANDED_BACK = range(3)
# Why it has handed back; see REASONS.
NOTHING, UNKNOWN, NOT_READY, MISSED, ROTOR_LOST, NO_MAP, LANDS = range(7)
REASONS = (
    "",
    "it saw what it was not trained on",
    "the drone was not ready for it",
    "it missed a gate",
    "a rotor is lost",
    "a gate is not on the map any more",
    "the drone has to land",
)


class PolicyMemory(NamedTuple):
    """What the controller remembers: numbers only, so that a step copies no objects."""

    phase: float  #: WAITING, FLYING or HANDED_BACK
    since: float  #: when that began (s)
    reason: float  #: why it has handed back, an index of REASONS
    passed: float  #: gates that were passed
    unknown: float  #: observations in a row that were not known
    yaw: float  #: of the body at the last step in flight, or when it handed back (rad)
    position: np.ndarray  #: p_WB then (m), (3,)
    velocity: np.ndarray  #: v_WB then (m/s), (3,); after the hand-back, what is to be braked
    action: np.ndarray  #: the last one, (4,)
    command: np.ndarray  #: what it stands for, see RateController, (4,)


_PACKING = Packing(PolicyMemory, position=3, velocity=3, action=4, command=4)
_as_memory, _memory_vector = _PACKING.parts, _PACKING.vector


class PolicyController(LeafSystem):
    """Races by a network once the map is complete; before and after, the planner flies.

    .. pydrake_system::

        name: PolicyController
        input_ports:
        - filtered_estimate
        - gate_map
        - explorer_status
        - exploration_reference
        - rotor_losses
        output_ports:
        - rate_command
        - policy_flies
        - safe_reference
        - policy_status

    ``filtered_estimate`` is a vehicle.State (14), ``gate_map`` a GateMap, ``explorer_status`` an
    ExplorerStatus, ``exploration_reference`` see trajopt/reference.py, ``rotor_losses`` see
    RotorMonitor. ``rate_command`` is for the RateController, ``policy_flies`` for the
    CommandSwitch, ``safe_reference`` (18) for the tracker and the planner in the place of the
    explorer's (while the network flies, it is where the drone is), and ``policy_status`` a
    PolicyStatus.

    - WAITING: the drone explores. The network takes over when the exploration is done, all gates
      that were found are on the map, and the drone hovers.
    - FLYING: fifty times a second, the network sees the observation ``gates`` of the
      environments, made of the estimate and the map in the place of the truth, and commands
      thrust and body rates. A gate counts when the estimate passes the opening that the map has.
    - HANDED_BACK: for good. The drone brakes where it is and hovers; then the planner plans a
      first lap from there. That happens if what it sees is not within what it was trained on for
      0.1 s, or not finite; if it misses a gate; if a rotor is lost; if the map loses a gate; and if
      the drone has to land.
    """

    def __init__(self, *, vehicle: Vehicle, network: PolicyNetwork):
        """Args: vehicle: that the network was trained on. network: from load_policy()."""
        LeafSystem.__init__(self)
        self._network, self._scale = network, ctbr_scale(vehicle)
        hover = np.array([vehicle.mass * GRAVITY, 0.0, 0.0, 0.0])
        self._estimate = self.DeclareVectorInputPort("filtered_estimate", STATE_SIZE)
        self._map = self.DeclareAbstractInputPort("gate_map", Value[object]())
        self._explorer = self.DeclareAbstractInputPort("explorer_status", Value[object]())
        self._exploration = self.DeclareVectorInputPort("exploration_reference", REFERENCE_SIZE)
        self._losses = self.DeclareVectorInputPort("rotor_losses", len(vehicle.rotors))
        nothing = PolicyMemory(*9 * [0.0], command=hover)  # type: ignore[arg-type, misc]
        self._memory = self.DeclareDiscreteState(_memory_vector(nothing))
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, 0.0, self._update)
        ticket = self.discrete_state_ticket(self._memory)
        for name, size, calc in (
            ("rate_command", 4, lambda m: m.command),
            ("policy_flies", 1, lambda m: [float(m.phase == FLYING)]),
        ):
            self.DeclareVectorOutputPort(
                name,
                size,
                lambda context, output, calc=calc: output.set_value(calc(self._recall(context))),
                {ticket},
            )
        self.DeclareVectorOutputPort(
            "safe_reference",
            REFERENCE_SIZE,
            self._calc_reference,
            {ticket, self.time_ticket(), self._exploration.ticket(), self._explorer.ticket()},
        )
        self.DeclareAbstractOutputPort(
            "policy_status",
            lambda: Value[object](PolicyStatus()),
            self._calc_status,
            {ticket, self.time_ticket()},
        )
        # So that all of it is compiled before the drone flies.
        self._act(as_state(np.eye(STATE_SIZE)[1]), np.ones((1, OPENING_SIZE)), 0, np.zeros(ACTIONS))
        find(np.ones(OPENING_SIZE), np.zeros(3), np.ones(3))

    @classmethod
    def from_scenario(cls, scenario: "Scenario") -> Self:
        """Returns the controller of a scenario.

        Raises:
            UserError: if there is no such network, or it is not for the drone.
        """
        from airrace.scenario import LEARNED

        vehicle, _ = load_vehicle(scenario.drone)
        path = Path(scenario.policy)
        if scenario.policy == LEARNED:
            path = models_path() / "policies" / f"{vehicle.name}.npz"
            if not path.exists():
                raise UserError(
                    f"There is no learned policy for the drone {vehicle.name}: train one with "
                    "examples/train_policy.py and name its file, or race with --policy none."
                )
        return cls(vehicle=vehicle, network=load_policy(path, vehicle))

    def _recall(self, context: Context) -> PolicyMemory:
        return _as_memory(context.get_discrete_state(self._memory).value())

    def _update(self, context, discrete_state):
        memory = self._recall(context)
        if memory.phase == HANDED_BACK:
            return
        explorer = self._explorer.Eval(context)
        after = self._next(
            memory,
            context.get_time(),
            as_state(self._estimate.Eval(context)),
            explorer,
            _course(self._map.Eval(context), explorer.gates),
            bool(np.isfinite(self._losses.Eval(context)).any()),
        )
        discrete_state.get_mutable_value(self._memory)[:] = _memory_vector(after)

    def _next(
        self,
        memory: PolicyMemory,
        time: float,
        state: State,
        explorer: ExplorerStatus,
        course: np.ndarray | None,
        rotor_lost: bool,
    ) -> PolicyMemory:
        """Returns the memory after a step.

        Args: course: the openings in the order of flight, (n, 15); None if the map has not all.
        """
        flies = memory.phase == FLYING
        if not (flies or explorer.done):
            return memory._replace(since=time)
        reason = NOTHING
        if explorer.state == LAND:
            reason = LANDS
        elif rotor_lost:
            reason = ROTOR_LOST
        elif course is None and flies:
            reason = NO_MAP
        elif course is None and time > memory.since + _LONGEST_WAIT:
            reason = NOT_READY
        if reason:
            return _handed_back(memory, time, state, reason)
        if course is None:
            return memory
        finite = all_finite(state_vector(state))
        if flies and finite:
            memory = _count(memory, state.position, course)
            if memory.reason:
                return _handed_back(memory, time, state, int(memory.reason))
        known, action = False, memory.action
        if finite:
            known, action = self._act(state, course, int(memory.passed), memory.action)
        if not flies:
            still = finite and np.linalg.norm(state.velocity) < _STILL
            if not (known and still):
                if time > memory.since + _LONGEST_WAIT:
                    return _handed_back(memory, time, state, NOT_READY)
                return memory
            memory = memory._replace(phase=FLYING, since=time, position=state.position)
        if finite:
            memory = memory._replace(velocity=state.velocity, yaw=reference_yaw(state.quaternion))
        unknown = 0.0 if known else memory.unknown + 1.0
        if unknown >= _PATIENCE:
            return _handed_back(memory, time, state, UNKNOWN)
        return memory._replace(unknown=unknown, action=action, command=scaled(action, self._scale))

    def _act(
        self, state: State, course: np.ndarray, passed: int, last: np.ndarray
    ) -> tuple[bool, np.ndarray]:
        """Returns whether the network knows what it sees, and its action, (4,)."""
        observation = np.empty(len(self._network.mean))
        write_gates_observation(observation, state, course, passed, last)
        return self._network.is_known(observation), self._network.act(observation)

    def _calc_reference(self, context, output):
        memory = self._recall(context)
        lands = self._explorer.Eval(context).state == LAND
        if memory.phase == WAITING or memory.reason == NOT_READY or lands:
            output.set_value(self._exploration.Eval(context))
        elif memory.phase == FLYING:  # so that the geometric controller can go on at any time
            m = memory
            wanted = Reference(m.position, m.velocity, 0.0, 0.0, 0.0, m.yaw, 0.0, 0.0)
            output.set_value(reference_vector(wanted))
        else:
            output.set_value(_stop(memory).reference(context.get_time() - memory.since))

    def _calc_status(self, context, output):
        memory, time = self._recall(context), context.get_time()
        rested = (
            memory.reason == NOT_READY or time >= memory.since + _stop(memory).braking_time + _REST
        )
        output.set_value(
            _status(
                flies=bool(memory.phase == FLYING),
                since=float(memory.since) if memory.phase != WAITING else 0.0,
                reason=REASONS[int(memory.reason)],
                planner_may_plan=bool(memory.phase == HANDED_BACK and rested),
                passed=int(memory.passed),
            )
        )


@functools.lru_cache(maxsize=4)  # another object tells a link that there is something new
def _status(**values: Any) -> PolicyStatus:
    return PolicyStatus(**values)


@functools.lru_cache(maxsize=4)  # a map is the same object until it changes
def _course(gate_map: GateMap, found: tuple) -> np.ndarray | None:
    """Returns the openings of gates in the order in which they were found, (n, 15).

    Args: found: their numbers.

    Returns: None if there are none, or one is not on the map.
    """
    known = {gate.number: gate for gate in gate_map.gates}
    if not found or not set(found) <= set(known):
        return None
    return map_openings([known[number] for number in found])


def _count(memory: PolicyMemory, position: np.ndarray, course: np.ndarray) -> PolicyMemory:
    """Returns the memory after a move, with one gate more, or with reason MISSED."""
    numbers = course[int(memory.passed) % len(course)]
    share, _ = find(numbers, memory.position, position)
    gate = as_opening(numbers)
    before, after = (
        float(gate.forward[:2] @ (p - gate.middle)[:2]) for p in (memory.position, position)
    )
    if not math.isnan(share):
        memory = memory._replace(passed=memory.passed + 1.0)
    elif before < 0.0 <= after:
        return memory._replace(reason=MISSED)
    return memory._replace(position=position)


def _handed_back(memory: PolicyMemory, time: float, state: State, reason: int) -> PolicyMemory:
    """Returns the memory after the hand-back; where the drone is, if that is known."""
    velocity, position, yaw = np.zeros(3), memory.position, memory.yaw
    if all_finite(state_vector(state)):
        velocity, position = state.velocity.copy(), state.position
        yaw = reference_yaw(state.quaternion)
    if position[2] + Stop(position, yaw, velocity).braking_distance[2] < _LEAST_HEIGHT:
        velocity[2] = 0.0
    return memory._replace(
        phase=HANDED_BACK, since=time, reason=reason, position=position, velocity=velocity, yaw=yaw
    )


def _stop(memory: PolicyMemory) -> Stop:
    """Returns the stop of a controller that has handed back."""
    return Stop(memory.position, memory.yaw, memory.velocity)
