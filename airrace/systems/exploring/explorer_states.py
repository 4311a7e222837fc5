"""The explorer's states: what each waits for, and what comes next."""

import dataclasses as dc
import itertools

import numpy as np

from airrace.systems.exploring import exploration
from airrace.systems.exploring.exploration import Now
from airrace.systems.exploring.explorer_legs import LegPlanner
from airrace.systems.exploring.explorer_memory import Memory
from airrace.systems.exploring.search import is_far, leads_to, next_steps
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.vehicle.state import as_state

_PERIOD = 0.2  # s, between two checks of a leg, or two attempts to plan one
_AT_GATE = 0.8  # s, before a gate is passed
_MOST_STEPS = 6  # of a search that are planned in one tick
_AT_REST = "level and at rest now"


class StateMachine:
    """The states of Explorer; it remembers nothing itself."""

    def __init__(
        self, *, config, hover_height: float, clearance: float, map_is_known: bool = False
    ):
        """Args: see Explorer."""
        self._config = config
        self._hover_height = hover_height
        self._map_is_known = map_is_known
        self._legs = LegPlanner(config=config, clearance=clearance)
        self._states = {
            "CALIBRATE": self._calibrate,
            "TAKE_OFF": self._take_off,
            "HOVER": self._hover,
            "FLY_TO_GATE": self._fly_to_gate,
            "RETURN": self._return,
            "DONE": lambda now: now.memory,
        }

    def next(self, now: Now) -> Memory:
        """Returns the memory of the next tick."""
        now = dc.replace(now, memory=now.memory.behind(now.time))
        return self._states.get(now.memory.status.state, self._search)(now)

    # The states. Each returns the memory of the next tick.

    def _calibrate(self, now):
        tilt = np.rad2deg(exploration.tilt(now.estimate))
        status = now.memory.status
        fault = exploration.fault_on_pad(now.estimate, self._config.max_level_error_deg)
        if fault is not None:
            # It is said once, not whenever a number changes.
            same = fault.split()[0] == status.reason.split()[0]
            return now.memory if same else now.memory.entered(now.time, "CALIBRATE", fault)
        if len(status.events) > 1 and status.reason != _AT_REST:
            return now.memory.entered(now.time, "CALIBRATE", _AT_REST)
        if now.time - status.since < self._config.hover_time:
            return now.memory
        pose = exploration.hover_pose(now.estimate)
        home = pose + [0.0, 0.0, self._hover_height, 0.0]
        memory = dc.replace(now.memory, home=home, leg=FlatTrajectory.resting(pose))
        now = dc.replace(now, memory=memory)
        leg = self._legs.plan(now, [[home]])
        return self._go(now, leg, "TAKE_OFF", f"level within {tilt:.1f} degrees, taking off")

    def _take_off(self, now):
        if self._arrived(now) is None:
            return now.memory
        return now.memory.entered(now.time, "HOVER", "reached the hover height")

    def _hover(self, now):
        arrived = self._arrived(now)
        waited = arrived is not None and now.time - arrived >= self._config.hover_time
        if self._map_is_known:
            return self._know(now) if waited else now.memory
        turned = self._turn_to_gate(now, waited)
        if turned is not None:
            return turned
        found = self._found(now)
        if found is not None:
            return found
        return self._seek(now) if waited else now.memory

    def _search(self, now):
        """STEP_FORWARD, LOOK_AROUND, STEP_AROUND, GO_BACK, ..., and TURN_TO_GATE."""
        if now.memory.last is not None or now.memory.aligned:
            found = self._found(now)
            if found is not None:
                return found
        if self._arrived(now) is not None:
            return now.memory.entered(now.time, "HOVER", "reached the set-point")
        if self._is_too_far(now) or self._can_go_on(now):
            return self._seek(now)
        return self._watch(now)

    def _fly_to_gate(self, now):
        found = self._found(now)
        if found is not None:
            return found
        if now.memory.ahead:
            return self._watch(now)
        near = exploration.presumed_gate(now.gate_map, now.next_number)
        if near and self._arrived(now) is None and not is_far(now, near, self._config):
            return self._watch(now)  # what was seen of it asks for a look at rest
        return self._seek(now)

    def _return(self, now):
        if self._arrived(now) is None:
            return self._watch(now)
        return now.memory.entered(now.time, "DONE", "hovering over the start", done=True)

    # What they share.

    def _know(self, now):
        """Returns the memory of a race without exploring."""
        gates = tuple(gate.number for gate in now.gate_map.gates)
        return now.memory.entered(
            now.time,
            "DONE",
            f"the map is given, with {len(gates)} gates",
            gates=gates,
            closed_at=now.time,
            done=True,
        )

    def _turn_to_gate(self, now, waited):
        """Returns the memory of turning to gate 1, None if there is no reason to."""
        memory = now.memory
        if memory.aligned or memory.last is not None:
            return None
        gate, what = now.gates.get(0), "gate 1 is off the heading"
        if gate is None and waited:
            gate = exploration.presumed_gate(now.gate_map, 0)
            what = exploration.described_observation(now, 0)
        if gate is None:
            return None
        error = exploration.heading_error(now, gate)
        angle = exploration.in_words(error)
        if abs(error) < np.deg2rad(self._config.max_heading_error_deg):
            memory = dc.replace(memory, aligned=True)
            return memory.entered(now.time, "HOVER", f"gate 1 is ahead, {angle}")
        if self._arrived(now) is None:
            return None
        pose = memory.goal
        pose[3] = exploration.yaw_of(now.estimate) + error
        leg = self._legs.plan(now, [[pose]])
        return self._go(now, leg, "TURN_TO_GATE", f"{what}, {angle}")

    def _found(self, now):
        """Returns the memory of flying to a gate just found, or None."""
        memory = now.memory
        gate = exploration.next_gate(now, self._config.closing_range)
        if gate is None or now.time < memory.blocked + _PERIOD or self._is_at_gate(now):
            return None
        if memory.last is not None and gate.number == 0:
            return self._go_home(now)
        gates = [*self._ahead(now), gate]
        leg = self._legs.plan_through(now, gates)
        if leg is None:
            # At rest nothing will change by itself.
            return (
                self._seek(now)
                if self._arrived(now) is not None
                else dc.replace(memory, blocked=now.time)
            )
        how = (
            "both front markers in one image"
            if exploration.both_in_image(now, gate.number)
            else "in the map already"
        )
        memory = dc.replace(
            memory,
            last=gate,
            steps=0,
            arounds=0,
            status=dc.replace(memory.status, gates=(*memory.status.gates, gate.number)),
        )
        reason = f"gate {gate.number + 1}: {how}"
        return self._go_through(dc.replace(now, memory=memory), leg, gates, "FLY_TO_GATE", reason)

    def _go_home(self, now):
        memory, gates = now.memory, self._ahead(now)
        leg = self._legs.plan_home(now, gates)
        if leg is None:
            return dc.replace(memory, blocked=now.time)
        reason = f"gate 1 again after {len(memory.status.gates)} gates: the loop is closed"
        memory = dc.replace(memory, status=dc.replace(memory.status, closed_at=now.time))
        return self._go_through(dc.replace(now, memory=memory), leg, gates, "RETURN", reason)

    def _seek(self, now):
        """Returns the memory of the next step of the search."""
        memory = now.memory
        if now.time < memory.blocked + _PERIOD:
            return memory
        for step in itertools.islice(next_steps(now, self._config), _MOST_STEPS):
            leg = self._legs.plan(now, step.routes)
            if leg is not None:
                memory = dc.replace(memory, steps=step.steps, arounds=step.arounds)
                return self._go(dc.replace(now, memory=memory), leg, step.state, step.reason)
        memory = dc.replace(memory, blocked=now.time)
        if self._arrived(now) is None:
            return memory
        # At rest nothing will change by itself: on to what comes after these.
        return dc.replace(memory, steps=step.steps, arounds=step.arounds)

    def _watch(self, now):
        """Returns the memory after a look at whether the leg is still good."""
        memory = now.memory
        if now.time < memory.checked + _PERIOD or self._is_at_gate(now):
            return memory
        memory = dc.replace(memory, checked=now.time)
        now = dc.replace(now, memory=memory)
        gates = self._ahead(now)
        moved = max(
            (np.linalg.norm(new.p_WG - old.p_WG) for new, (old, _) in zip(gates, memory.ahead)),
            default=0.0,
        )
        good = self._legs.is_good(now, gates)
        if good and moved < self._config.replan_distance:
            return memory
        state = memory.status.state
        if state == "RETURN" or gates:
            plan = self._legs.plan_home if state == "RETURN" else self._legs.plan_through
            why = (
                f"what is ahead is {moved:.1f} m from where it seemed"
                if good
                else "the way there is not free"
            )
            return self._go_through(now, plan(now, gates), gates, state, why)
        return (
            memory
            if good
            else self._go(now, self._legs.plan_stop(now), "AVOID", "something is in the way")
        )

    def _is_too_far(self, now):
        """Whether a step leads too near to a gate of which something was just seen."""
        if now.memory.status.state != "STEP_FORWARD":
            return False
        gate = exploration.presumed_gate(now.gate_map, now.next_number)
        return gate is not None and leads_to(now.memory.goal, gate, self._config)

    def _can_go_on(self, now):
        """Whether one step forward may follow another without a stop."""
        if now.memory.status.state != "STEP_FORWARD":
            return False
        to_go = np.linalg.norm(now.memory.goal[:3] - as_state(now.estimate).position)
        braking = self._config.max_speed**2 / self._config.max_acceleration
        return to_go < braking and next(next_steps(now, self._config)).state == "STEP_FORWARD"

    def _is_at_gate(self, now):
        """Whether a gate is about to be passed: a new leg could only spoil that."""
        passing = [time for _, time in now.memory.ahead]
        return bool(passing) and now.memory.leg_start + passing[0] < now.time + _AT_GATE

    def _ahead(self, now):
        """Returns the gates on the leg as the map has them now."""
        return [now.gates.get(gate.number, gate) for gate, _ in now.memory.ahead]

    def _go_through(self, now, leg, gates, state, reason):
        """Returns the memory of flying a leg through gates; as before if there is none."""
        memory = self._go(now, leg, state, reason)
        if leg is None:
            return memory
        times = self._legs.passing_times(leg, gates)
        return dc.replace(memory, ahead=tuple(zip(gates, times)))

    def _go(self, now, leg, state, reason):
        """Returns the memory of flying a leg; as before if there is none."""
        if leg is None:
            return now.memory
        return now.memory.flying(leg, now.time).entered(now.time, state, reason)

    def _arrived(self, now):
        """Returns when the drone reached the end of its leg, None before."""
        memory = now.memory
        distance = np.linalg.norm(as_state(now.estimate).position - memory.goal[:3])
        near = distance < self._config.reached_distance
        return memory.leg_end if near and now.time >= memory.leg_end else None
