"""Finds the gates of an unknown track."""

from typing import Self

from pydrake.common.value import Value
from pydrake.systems.framework import Context, EventStatus

from airrace.scenario import ExplorerConfig, Scenario
from airrace.systems.exploring import exploration
from airrace.systems.exploring.explorer_memory import Memory, Situation
from airrace.systems.exploring.explorer_states import StateMachine
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.types import ExplorerStatus
from airrace.track import load_track
from airrace.trajopt.feasibility import clearance_of
from airrace.trajopt.flat_trajectory import idle
from airrace.trajopt.reference import REFERENCE_SIZE
from airrace.vehicle import load_vehicle
from airrace.vehicle.state import STATE_SIZE


class Explorer(LeafSystem):
    """Section IV of the Student AirRace paper and its flow chart (fig. 8).

    .. pydrake_system::

        name: Explorer
        input_ports:
        - detections
        - gate_map
        - state_estimate
        - estimate_fault (may be left open: there is none)
        - estimate_drift (may be left open: there is none)
        output_ports:
        - exploration_reference
        - explorer_status

    ``detections`` is a Detections, ``gate_map`` a GateMap, ``state_estimate``
    see vehicle/state.py, ``estimate_fault`` and ``estimate_drift`` see GateSlam;
    ``exploration_reference`` see
    trajopt/reference.py, ``explorer_status`` an ExplorerStatus.

    The states, and what each waits for; explorer_states.py has the transitions:

    - CALIBRATE: nearly level and at rest on the pad; then takes off.
    - TAKE_OFF: the hover height, levelling in the air.
    - HOVER: the drone at its set-point, and some images there.
    - TURN_TO_GATE: gate 1 is off the heading, so turn until it is ahead.
    - STEP_FORWARD: no gate in sight, so on along the last gate's heading; with
      ``hover_before_step`` from HOVER to HOVER, otherwise without a stop.
    - LOOK_AROUND: steps forward did not help, so turn on the spot. At the
      start, this comes before any step.
    - STEP_AROUND: a board of the gate was observed, so to where both of its front
      markers should be in view.
    - LOOK_BACK: without a gate in sight the drone knows less and less where it is, so to where
      the nearest known gate can be read, until it knows it again.
    - GO_BACK: all that did not help, so back to the last gate.
    - LOOK_FROM_ABOVE: nor did turning there, so search from above the pylons, in growing
      distances.
    - FLY_TO_GATE: through every gate found and not yet passed. Gates found
      meanwhile extend the leg without a stop; after the last, the search goes on.
    - AVOID: a pylon that was just found is in the way, so stop.
    - RETURN: gate 1 was found again, or as many gates as are expected, so through the
      gates still ahead, if the estimate drifts also gate 1, and home.
    - DONE: hovering there, ready to race.
    - LAND: the estimate is of no use any more, in the race, too, or the drone did not reach its
      hover height; so down on the spot, for good.

    From all states between TAKE_OFF and RETURN, FLY_TO_GATE follows as soon as
    the next gate is in the map. A search ends when a gate is found, or with the
    race.
    """

    def __init__(
        self,
        *,
        config: ExplorerConfig,
        hover_height: float,
        clearance: float,
        map_is_known: bool = False,
        drifts: bool = False,
    ):
        """Constructs the explorer.

        Args:
            config: an ExplorerConfig.
            hover_height: of the first hover above the start (m).
            clearance: to keep from pylons' axes (m).
            map_is_known: whether there is nothing to explore: it takes off, and is done.
            drifts: whether the drone has to find out itself where it is, so that its estimate
                drifts until it sees known gates again. Then it rests longer on its pad, and flies
                through gate 1 and looks at gate 2 before it returns.
        """
        LeafSystem.__init__(self)
        self._machine = StateMachine(
            config=config,
            hover_height=hover_height,
            clearance=clearance,
            map_is_known=map_is_known,
            drifts=drifts,
        )
        self._detections = self.DeclareAbstractInputPort("detections", Value[object]())
        self._map = self.DeclareAbstractInputPort("gate_map", Value[object]())
        self._estimate = self.DeclareVectorInputPort("state_estimate", STATE_SIZE)
        self._fault = self.DeclareAbstractInputPort("estimate_fault", Value[object]())
        self._drift = self.DeclareVectorInputPort("estimate_drift", 1)
        self._memory = self.DeclareAbstractState(Value[object](Memory()))
        self.DeclarePeriodicUnrestrictedUpdateEvent(1.0 / config.rate, 0.0, self._update)
        ticket = self.abstract_state_ticket(self._memory)
        self.DeclareVectorOutputPort(
            "exploration_reference",
            REFERENCE_SIZE,
            self._calc_reference,
            {ticket, self.time_ticket(), self._estimate.ticket()},
        )
        self.DeclareAbstractOutputPort(
            "explorer_status",
            lambda: Value[object](ExplorerStatus()),
            lambda context, output: output.set_value(self._read_memory(context).status),
            {ticket},
        )

    @classmethod
    def from_scenario(cls, scenario: Scenario, drifts: bool = False) -> Self:
        """Returns the explorer of a scenario; drifts: see the constructor."""
        return cls(
            config=scenario.explorer,
            # The hover height is a rule of the race; nothing else of the track is read.
            hover_height=load_track(scenario.track, markers=True).hover_height,
            clearance=clearance_of(load_vehicle(scenario.drone)[0].radius),  # type: ignore[arg-type]
            map_is_known=bool(scenario.map),
            drifts=drifts,
        )

    def _read_memory(self, context: Context) -> Memory:
        return context.get_abstract_state(int(self._memory)).get_value()

    def _calc_reference(self, context, output):
        memory = self._read_memory(context)
        if memory.status.state == "CALIBRATE":
            *position, yaw = exploration.hover_pose(self._estimate.Eval(context))
            output.set_value(idle(position, yaw))
        else:
            output.set_value(memory.leg.reference(context.get_time() - memory.leg_start))

    def _update(self, context, state):
        memory = self._read_memory(context)
        fault = self._fault.Eval(context) if self._fault.HasValue(context) else ""
        drift = self._drift.Eval(context)[0] if self._drift.HasValue(context) else 0.0
        if memory.status.done and not fault:
            return EventStatus.DidNothing()
        after = self._machine.next(
            Situation(
                memory=memory,
                time=context.get_time(),
                detections=self._detections.Eval(context),
                gate_map=self._map.Eval(context),
                estimate=self._estimate.Eval(context),
                fault=fault,
                drift=float(drift),
            )
        )
        if after is memory:
            # Then Drake computes nothing anew that depends on the state.
            return EventStatus.DidNothing()
        state.get_mutable_abstract_state(int(self._memory)).set_value(after)
        return EventStatus.Succeeded()
