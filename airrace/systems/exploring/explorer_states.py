"""The explorer's state machine: the states, what each waits for, and the transitions.

    CALIBRATE -> TAKE_OFF -> HOVER -> FLY_TO_GATE -> RETURN -> DONE

From HOVER, TURN_TO_GATE and the steps of the search (see search.py) lead back to HOVER, and
every state of flight to FLY_TO_GATE. AVOID follows if the leg is not clear any more, and LAND
every state if the estimate is of no use any more, or TAKE_OFF if the drone does not rise.
"""

import dataclasses as dc
import itertools

import numpy as np

from airrace.scenario import ExplorerConfig
from airrace.systems.exploring import exploration
from airrace.systems.exploring.explorer_legs import LegPlanner
from airrace.systems.exploring.explorer_memory import Memory, Situation
from airrace.systems.exploring.search import is_far, is_lost, leads_to, next_steps, step_back
from airrace.systems.types import LAND
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.stop import Landing, Stop
from airrace.vehicle.state import as_state

_PERIOD = 0.2  # s, between two checks of a leg, or two attempts to plan one
_AT_GATE = 0.8  # s, before a gate is passed
_MOST_STEPS = 6  # of a search that are planned in one tick
# m, of the position relative to the known gates: with more, the drone would soon not find back to
# them; with less, it knows its place again.
_UNSURE, _SURE = 1.0, 0.3
_AT_REST = "level and at rest now"
# s, that a drone with `vio` rests on its pad: the longer, the better it knows the bias of its
# gyroscope, and its heading once it flies.
_REST = 2.0
_CLIMB = 20.0  # s, after which a drone that should hover never will


class StateMachine:
    """The states of Explorer; what changes is in the Memory of the Situation."""

    def __init__(
        self,
        *,
        config: ExplorerConfig,
        hover_height: float,
        clearance: float,
        map_is_known: bool = False,
        drifts: bool = False,
    ):
        """Args: see Explorer."""
        self._config = config
        self._hover_height = hover_height
        self._map_is_known = map_is_known
        self._rest = _REST if drifts else config.hover_time
        self._closes_loop = drifts
        self._legs = LegPlanner(config=config, clearance=clearance)
        self._states = {
            "CALIBRATE": self._calibrate,
            "TAKE_OFF": self._take_off,
            "HOVER": self._hover,
            "FLY_TO_GATE": self._fly_to_gate,
            "RETURN": self._return,
            "DONE": lambda now: now.memory,
        }

    def next(self, now: Situation) -> Memory:
        """Returns the memory of the next tick."""
        memory = now.memory
        if memory.status.state == LAND:
            return memory
        if now.fault:
            return self._land(now, now.fault)
        ahead = tuple(each for each in memory.gates_ahead if memory.leg_start + each[1] > now.time)
        if len(ahead) < len(memory.gates_ahead):
            now = now.remembering(gates_ahead=ahead)
        return self._states.get(now.memory.status.state, self._search)(now)

    # The states: what happens in a tick. Each returns the memory of the next tick.

    def _calibrate(self, now):
        """Waits until the drone is level and at rest, then takes off."""
        memory, status = now.memory, now.memory.status
        fault = exploration.fault_on_pad(now.estimate, self._config.max_level_error_deg)
        if fault is not None:
            # Only another fault is an event, not another number in it.
            same = fault.split()[0] == status.reason.split()[0]
            return memory if same else memory.entered(now.time, "CALIBRATE", fault)
        if len(status.events) > 1 and status.reason != _AT_REST:
            return memory.entered(now.time, "CALIBRATE", _AT_REST)
        if now.time - status.since < self._rest:
            return memory
        tilt = np.rad2deg(exploration.tilt(now.estimate))
        pose = exploration.hover_pose(now.estimate)
        home = pose + [0.0, 0.0, self._hover_height, 0.0]
        now = now.remembering(home=home, leg=FlatTrajectory.resting(pose))
        leg = self._legs.plan(now, [[home]])
        return self._follow(now, leg, "TAKE_OFF", f"level within {tilt:.1f} degrees, taking off")

    def _take_off(self, now):
        """Waits for the hover height, but not for ever."""
        if self._arrival_time(now) is None:
            if now.time < now.memory.leg_end + _CLIMB:
                return now.memory
            height = as_state(now.estimate).position[2] - now.memory.goal[2] + self._hover_height
            return self._land(
                now,
                f"it is {height:z.1f} m above its pad {_CLIMB:.0f} s after it should hover at "
                f"{self._hover_height:.1f} m: check the controller's thrust and the drone's mass",
            )
        return now.memory.entered(now.time, "HOVER", "reached the hover height")

    def _hover(self, now):
        """Waits for the set-point and some images there, then decides what comes next."""
        arrival = self._arrival_time(now)
        waited = arrival is not None and now.time - arrival >= self._config.hover_time
        if self._map_is_known:
            if not waited:
                return now.memory
            gates = tuple(gate.number for gate in now.gate_map.gates)
            reason = f"the map is given, with {len(gates)} gates"
            known = dict(gates=gates, closed_at=now.time, done=True)
            return now.memory.entered(now.time, "DONE", reason, **known)
        after = self._turn_to_gate(now, waited) or self._fly_to_next_gate(now)
        if after is None:
            return self._take_search_step(now) if waited else now.memory
        return after

    def _search(self, now):
        """All steps of the search, TURN_TO_GATE and AVOID: wait for the set-point or a gate."""
        if now.memory.last is not None or now.memory.aligned:
            after = self._fly_to_next_gate(now)
            if after is not None:
                return after
        if self._arrival_time(now) is not None:
            return now.memory.entered(now.time, "HOVER", "reached the set-point")
        if now.memory.status.state == "LOOK_BACK":
            if now.drift < _SURE:
                return self._take_search_step(now)
        elif (after := self._look_back(now)) is not None:
            return after
        if now.memory.status.state == "STEP_FORWARD" and self._steps_on(now):
            return self._take_search_step(now)
        return self._check_leg(now)

    def _fly_to_gate(self, now):
        """Waits for the next gate, or for the last one to be passed."""
        after = self._fly_to_next_gate(now)
        if after is not None:
            return after
        if now.memory.gates_ahead:
            return self._check_leg(now)
        if self._arrival_time(now) is None:
            gate = exploration.presumed_gate(now.gate_map, now.next_number)
            # At rest, its other markers may be detected better.
            if self._config.hover_before_step or gate and not is_far(now, gate, self._config):
                return self._check_leg(now)
        elif self._config.hover_before_step:
            return now.memory.entered(now.time, "HOVER", "reached the set-point")
        return self._take_search_step(now)

    def _return(self, now):
        """Waits for the arrival over the start."""
        if self._arrival_time(now) is None:
            return self._check_leg(now)
        return now.memory.entered(now.time, "DONE", "hovering over the start", done=True)

    def _land(self, now, reason):
        """Returns the memory of a drone that comes down where it is, for good."""
        landing = Landing(Stop.of(now.estimate, now.memory.home[2] - self._hover_height))
        # From here on, nothing is asked of a leg but its reference.
        memory = now.memory.flying(landing, now.time)
        return memory.entered(now.time, LAND, reason)

    # The transitions. Each returns the memory in the new state, or None, or the memory as it
    # was, if its condition is not met.

    def _turn_to_gate(self, now, waited):
        """Turns to gate 1 if that is off the heading; None if there is no reason to."""
        memory = now.memory
        if memory.aligned or memory.last is not None:
            return None
        gate, what = now.gates.get(0), "gate 1 is off the heading"
        if gate is None and waited:
            gate = exploration.presumed_gate(now.gate_map, 0)
            what = exploration.describe_observation(now, 0)
        if gate is None:
            return None
        error = exploration.heading_error(now, gate)
        angle = exploration.angle_in_words(error)
        if abs(error) < np.deg2rad(self._config.max_heading_error_deg):
            memory = dc.replace(memory, aligned=True)
            return memory.entered(now.time, "HOVER", f"gate 1 is ahead, {angle}")
        if self._arrival_time(now) is None:
            return None
        pose = memory.goal
        pose[3] = exploration.yaw_of(now.estimate) + error
        leg = self._legs.plan(now, [[pose]])
        return self._follow(now, leg, "TURN_TO_GATE", f"{what}, {angle}")

    def _fly_to_next_gate(self, now):
        """Flies to a gate that was just found, after those ahead; None if there is none.

        After the last gate it returns home.
        """
        memory, found = now.memory, len(now.memory.status.gates)
        all_found = found == self._config.expected_gates
        lost = is_lost(now, self._config)
        gate = exploration.next_gate(now, self._config.closing_range, lost)
        closes = memory.last is not None and gate is not None and gate.number == 0
        nothing_new = gate is None and not all_found
        if nothing_new or now.time < memory.blocked_at + _PERIOD:
            return None
        if self._is_at_gate(now):
            return dc.replace(memory, closing=True) if closes and not memory.closing else None
        if all_found:
            return self._return_home(now, f"all {found} gates that are expected were found")
        if closes:
            return self._return_home(now, f"gate 1 again after {found} gates: the loop is closed")
        gates = [*self._gates_ahead(now), gate]
        leg = self._legs.plan_through(now, gates)
        if leg is None:
            if self._arrival_time(now) is not None:
                # At rest, the next attempt would fail as well.
                return self._take_search_step(now)
            return dc.replace(memory, blocked_at=now.time)
        both = len(exploration.front_markers(now, gate.number)) == 2
        how = "both front markers in one image" if both else "in the map already"
        status = dc.replace(memory.status, gates=(*memory.status.gates, gate.number))
        now = now.remembering(last=gate, closing=False, steps=0, steps_around=0, status=status)
        reason = f"gate {gate.number + 1}: {how}"
        return self._follow(now, leg, "FLY_TO_GATE", reason, gates)

    def _return_home(self, now, reason):
        """Flies home through the gates ahead, for there are no others."""
        memory, gates = now.memory, self._gates_ahead(now)
        if self._closes_loop and {0, 1} <= now.gates.keys():
            gates = [*gates, now.gates[0]]
        leg = self._plan_home(now, gates)
        if leg is None and len(gates) > len(memory.gates_ahead):
            gates = gates[:-1]
            leg = self._plan_home(now, gates)
        if leg is None:
            return dc.replace(memory, blocked_at=now.time)
        now = now.remembering(status=dc.replace(memory.status, closed_at=now.time))
        return self._follow(now, leg, "RETURN", reason, gates)

    def _plan_home(self, now, gates):
        """Returns the leg home; if gate 1 is to be passed on the way, gate 2 is looked at."""
        looks = self._closes_loop and gates and gates[-1].number == 0
        return self._legs.plan_home(now, gates, now.gates.get(1) if looks else None)

    def _look_back(self, now):
        """Looks at a known gate again if it is unsure of its place; None if there is no reason to.

        Also if there is no clear leg now.
        """
        if now.drift < _UNSURE or now.time < now.memory.blocked_at + _PERIOD:
            return None
        step = step_back(now, self._config)
        if step is None:
            return None
        leg = self._legs.plan(now, step.routes)
        if leg is None:
            return None
        return self._follow(now, leg, step.state, step.reason)

    def _take_search_step(self, now):
        """Takes the first of the next search steps to which a clear leg leads."""
        memory = now.memory
        if now.time < memory.blocked_at + _PERIOD:
            return memory
        after = self._look_back(now)
        if after is not None:
            return after
        steps = next_steps(now, self._config)
        if memory.status.state == "LOOK_BACK" and not is_lost(now, self._config):
            # Where it was going, it would be unsure again, and too far away to look back.
            steps = itertools.dropwhile(lambda step: step.state != "GO_BACK", steps)
        for step in itertools.islice(steps, _MOST_STEPS):
            leg = self._legs.plan(now, step.routes)
            if leg is not None:
                now = now.remembering(steps=step.steps, steps_around=step.steps_around)
                return self._follow(now, leg, step.state, step.reason)
        memory = dc.replace(memory, blocked_at=now.time)
        if self._arrival_time(now) is None:
            return memory
        # At rest, the next attempt would fail as well: skip these steps.
        return dc.replace(memory, steps=step.steps, steps_around=step.steps_around)

    def _check_leg(self, now):
        """Plans the leg again if it is not clear any more, or if the gates ahead have moved."""
        if now.time < now.memory.checked_at + _PERIOD or self._is_at_gate(now):
            return now.memory
        now = now.remembering(checked_at=now.time)
        memory, gates, state = now.memory, self._gates_ahead(now), now.memory.status.state
        moves = [new.p_WG - old.p_WG for new, (old, _) in zip(gates, memory.gates_ahead)]
        moved = max(map(np.linalg.norm, moves), default=0.0)
        is_clear = self._legs.is_clear(now, gates)
        if is_clear and moved < self._config.replan_distance:
            return memory
        if state == "RETURN" or gates:
            plan = self._plan_home if state == "RETURN" else self._legs.plan_through
            reason = (
                f"what is ahead is {moved:.1f} m from where it seemed"
                if is_clear
                else "the way there is not free"
            )
            return self._follow(now, plan(now, gates), state, reason, gates)
        if is_clear:
            return memory
        return self._follow(now, self._legs.plan_stop(now), "AVOID", "something is in the way")

    def _follow(self, now, leg, state, reason, gates=()):
        """Returns the memory of a leg through gates, in a new state; as it was for no leg."""
        if leg is None:
            return now.memory
        memory = now.memory.flying(leg, now.time).entered(now.time, state, reason)
        if gates:
            times = self._legs.passing_times(leg, gates)
            memory = dc.replace(memory, gates_ahead=tuple(zip(gates, times)))
        return memory

    # The conditions.

    def _steps_on(self, now):
        """Whether to go on from a step forward without a stop.

        It may end too near to a gate of which a board was just detected, or another follows.
        """
        if self._config.hover_before_step:
            return False
        gate = exploration.presumed_gate(now.gate_map, now.next_number)
        if gate is not None and leads_to(now.memory.goal, gate, self._config):
            return True
        to_go = np.linalg.norm(now.memory.goal[:3] - as_state(now.estimate).position)
        braking = self._config.max_speed**2 / self._config.max_acceleration
        return to_go < braking and next(next_steps(now, self._config)).state == "STEP_FORWARD"

    def _is_at_gate(self, now):
        """Whether a gate is about to be passed: too late for another leg."""
        times = [time for _, time in now.memory.gates_ahead]
        return bool(times) and now.memory.leg_start + times[0] < now.time + _AT_GATE

    def _gates_ahead(self, now):
        """Returns the gates on the leg as the map has them now."""
        return [now.gates.get(gate.number, gate) for gate, _ in now.memory.gates_ahead]

    def _arrival_time(self, now):
        """Returns when the drone reached the end of its leg (s), None before."""
        memory = now.memory
        distance = np.linalg.norm(as_state(now.estimate).position - memory.goal[:3])
        near = distance < self._config.reached_distance
        return memory.leg_end if near and now.time >= memory.leg_end else None
