"""Finds the gates of a track that nobody has seen."""

import dataclasses as dc

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import LeafSystem

from airrace.immutable import Immutable
from airrace.systems import exploration
from airrace.systems import state_estimate as se
from airrace.systems.types import ExplorerStatus
from airrace.trajopt.flat_trajectory import SIZE, FlatTrajectory, hold
from airrace.trajopt.leg import plan_leg
from airrace.trajopt.min_snap import TrajectoryOptimizationError


@dc.dataclass(frozen=True, eq=False)
class _Memory(Immutable):
    """The explorer's state.

    Attributes:
        status: what the world may know.
        leg, leg_start: trajectory being flown and when it started (s).
        home: hover pose over the start: x, y, z and yaw, (4,).
        last: newest gate of the list, a GateEstimate, or None.
        ahead: gates on the leg and the times on it at which they are passed.
        stepped_around: whether the last step of the search was one around.
        steps: of the search for the next gate so far, forward and looks around.
    """

    status: ExplorerStatus
    leg: FlatTrajectory | None = None
    leg_start: float = 0.0
    home: np.ndarray | None = None
    last: object = None
    ahead: tuple = ()
    stepped_around: bool = False
    steps: int = 0


class Explorer(LeafSystem):
    """Section IV of the Student AirRace report and its flow chart (fig. 8).

    .. pydrake_system::

        name: Explorer
        input_ports:
        - detections
        - gate_map
        - state_estimate
        output_ports:
        - exploration_reference
        - explorer_status

    ``detections`` is a Detections, ``gate_map`` a GateMap, ``state_estimate``
    see state_estimate.py; ``exploration_reference`` see
    trajopt/flat_trajectory.py, ``explorer_status`` an ExplorerStatus.

    States, and what they wait for:

    - CALIBRATE: level and at rest on the pad; then takes off.
    - TAKE_OFF: up to the hover height.
    - HOVER: the drone at its set-point, looking; a gate whose two front
      markers are in one image is the next gate.
    - STEP_FORWARD: nothing in sight, so on along the last gate's heading.
    - LOOK_AROUND: steps forward did not help, so turn left, then right.
    - STEP_AROUND: one marker in sight, so to where both should be.
    - FLY_TO_GATE: through every gate found and not yet passed. Gates found on
      the way extend the leg without a stop; after the last, the search goes on.
    - RETURN: gate 1 showed up again, so through what is left and home.
    - DONE: hovering there, ready to race.
    """

    def __init__(self, *, config, hover_height: float, clearance: float):
        """Constructs the explorer.

        Args:
            config: an ExplorerConfig.
            hover_height: of the first hover above the start (m).
            clearance: to keep from pylons' axes (m).
        """
        LeafSystem.__init__(self)
        self._config = config
        self._hover_height = hover_height
        self._clearance = clearance
        self._detections = self.DeclareAbstractInputPort("detections", Value[object]())
        self._map = self.DeclareAbstractInputPort("gate_map", Value[object]())
        self._estimate = self.DeclareVectorInputPort("state_estimate", se.SIZE)
        self._memory = self.DeclareAbstractState(Value[object](_Memory(ExplorerStatus())))
        self.DeclarePeriodicUnrestrictedUpdateEvent(1.0 / config.rate, 0.0, self._Update)
        ticket = self.abstract_state_ticket(self._memory)
        self.DeclareVectorOutputPort(
            "exploration_reference", SIZE, self._CalcReference,
            {ticket, self.time_ticket(), self._estimate.ticket()},
        )
        self.DeclareAbstractOutputPort(
            "explorer_status",
            lambda: Value[object](ExplorerStatus()),
            lambda context, output: output.set_value(self._Recall(context).status),
            {ticket},
        )
        self._transitions = {
            "CALIBRATE": self._Calibrate,
            "TAKE_OFF": self._TakeOff,
            "HOVER": self._Hover,
            "STEP_FORWARD": self._Search,
            "LOOK_AROUND": self._Search,
            "STEP_AROUND": self._Search,
            "FLY_TO_GATE": self._FlyToGate,
            "RETURN": self._Return,
            "DONE": lambda now: now.memory,
        }

    def _Recall(self, context) -> _Memory:
        return context.get_abstract_state(int(self._memory)).get_value()

    def _CalcReference(self, context, output):
        memory = self._Recall(context)
        if memory.leg is None:  # still on the pad
            x, y, z, yaw = exploration.hover_pose(self._estimate.Eval(context))
            output.set_value(hold([x, y, z], yaw))
        else:
            output.set_value(memory.leg.reference(context.get_time() - memory.leg_start))

    def _Update(self, context, state):
        memory = self._Recall(context)
        now = exploration.Now(
            memory=memory,
            time=context.get_time(),
            detections=self._detections.Eval(context),
            gate_map=self._map.Eval(context),
            estimate=self._estimate.Eval(context),
        )
        try:
            after = self._transitions[memory.status.state](now)
        except TrajectoryOptimizationError:
            # No leg from this moment's motion: fly on and try again from the
            # next. From rest, where every leg ends, there always is one.
            return
        if after is not memory:
            state.get_mutable_abstract_state(int(self._memory)).set_value(after)

    # The states. Each returns the memory of the next tick.

    def _Calibrate(self, now):
        tilt = exploration.tilt(now.estimate)
        if now.time < self._config.hover_time or tilt > np.deg2rad(
            self._config.max_level_error_deg
        ):
            return now.memory
        pose = exploration.hover_pose(now.estimate)
        home = pose + [0.0, 0.0, self._hover_height, 0.0]
        memory = dc.replace(now.memory, home=home, leg=FlatTrajectory.resting(pose))
        reason = f"level within {np.rad2deg(tilt):.1f} degrees, taking off"
        return self._Go(now, memory, "TAKE_OFF", reason, [home])

    def _TakeOff(self, now):
        if self._Arrived(now) is None:
            return now.memory
        return self._Enter(now, now.memory, "HOVER", "reached the hover height")

    def _Hover(self, now):
        found = self._Found(now)
        if found is not None:
            return found
        arrived = self._Arrived(now)
        if arrived is None or now.time - arrived < self._config.hover_time:
            return now.memory
        return self._Seek(now)

    def _Search(self, now):
        found = self._Found(now)
        if found is not None:
            return found
        if self._Arrived(now) is None:
            return now.memory
        return self._Enter(now, now.memory, "HOVER", "reached the set-point")

    def _FlyToGate(self, now):
        memory = now.memory
        t = now.time - memory.leg_start
        ahead = tuple((gate, passing) for gate, passing in memory.ahead if passing > t)
        if len(ahead) < len(memory.ahead):
            memory = dc.replace(memory, ahead=ahead)
            now = dc.replace(now, memory=memory)
        found = self._Found(now)
        if found is not None:
            return found
        return memory if ahead else self._Seek(now)

    def _Return(self, now):
        if self._Arrived(now) is None:
            return now.memory
        return self._Enter(now, now.memory, "DONE", "hovering over the start", done=True)

    # What they share.

    def _Found(self, now):
        """Returns the memory of flying to a gate just found, or None."""
        memory = now.memory
        gate = exploration.next_gate(now, self._config.closing_range)
        if gate is None:
            return None
        if memory.last is not None and gate.number == 0:
            status = dc.replace(memory.status, closed_at=now.time)
            memory = dc.replace(memory, status=status, ahead=())
            reason = f"gate 1 again after {len(memory.status.gates)} gates: the loop is closed"
            routes = exploration.ways_home(now, self._config)
            return self._Go(now, memory, "RETURN", reason, *routes)
        gates = tuple(g for g, _ in memory.ahead) + (gate,)
        waypoints = [exploration.gate_pose(g) for g in gates]
        beyond = exploration.gate_pose(gate, self._config.passing_distance)
        memory = dc.replace(
            memory,
            last=gate,
            steps=0,
            status=dc.replace(memory.status, gates=(*memory.status.gates, gate.number)),
        )
        reason = f"both front markers of gate {gate.number + 1} in one image"
        memory = self._Go(now, memory, "FLY_TO_GATE", reason, [*waypoints, beyond])
        return dc.replace(memory, ahead=tuple(zip(gates, memory.leg.breaks[1:])))

    def _Seek(self, now):
        """Returns the memory of the next step of the search."""
        target, state, reason = exploration.search_target(now, self._config)
        around = state == "STEP_AROUND"
        steps = 0 if around else now.memory.steps + 1
        memory = dc.replace(now.memory, stepped_around=around, steps=steps)
        return self._Go(now, memory, state, reason, [target])

    def _Go(self, now, memory, state, reason, *routes):
        """Returns the memory of a new leg from the current reference on.

        Of several routes it takes the first that keeps clear of all known
        pylons, else the last.
        """
        start = memory.leg.derivatives(now.time - memory.leg_start)
        limits = dict(
            max_speed=self._config.max_speed, max_acceleration=self._config.max_acceleration
        )
        for route in routes:
            leg = plan_leg(start, np.array(route), **limits)
            if exploration.is_clear(leg, now.gate_map, self._clearance):
                break
        memory = dc.replace(memory, leg=leg, leg_start=now.time)
        return self._Enter(now, memory, state, reason)

    def _Enter(self, now, memory, state, reason, done=False):
        status = dc.replace(
            memory.status, state=state, reason=reason, since=now.time, done=done
        )
        return dc.replace(memory, status=status)

    def _Arrived(self, now):
        """Returns when the drone reached the end of its leg, None before."""
        memory = now.memory
        end = memory.leg_start + memory.leg.duration
        goal = memory.leg.derivatives(memory.leg.duration, 1)[0, :3]
        near = np.linalg.norm(now.estimate[se.POSITION] - goal) < self._config.reached_distance
        return end if near and now.time >= end else None
