"""The referee: counts gates and laps, and ends the race, on truth."""

import functools
import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import QueryObject
from pydrake.multibody.plant import ContactResults
from pydrake.systems.framework import Context

from airrace.common.jit import assign, compiled
from airrace.common.packing import Packing
from airrace.math.vec3 import dot
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_vector
from airrace.systems.sensing.contact_names import FLOOR, TAKE_OFF, nearest_name
from airrace.systems.types import LAND, ExplorerStatus, GateCrossing, RefereeStatus
from airrace.track import Course
from airrace.track.gate_opening import find
from airrace.vehicle.disturbances import failures_clause
from airrace.vehicle.state import as_plant_state

OUT_OF_TIME = "ran out of time"
# Verdicts, and the reasons of those that are not a success.
UNDECIDED, FINISHED, GROUND, TOUCHED, ARENA, TIMEOUT, DIVERGED, LANDED = range(8)
_REASONS = {
    GROUND: "hit the ground",
    TOUCHED: "touched {what}",
    ARENA: "left the arena",
    TIMEOUT: OUT_OF_TIME,
    DIVERGED: "the simulation failed",
}


class Criteria(NamedTuple):
    """What a flight is judged by."""

    gates: np.ndarray  #: openings of all, (n, 15), see Opening
    take_off_height: float  #: above which the drone flies (m)
    time_limit: float  #: for the whole race (s)
    arena_min: np.ndarray  #: x and y of the arena (m), (2,)
    arena_max: np.ndarray  #: its x, y and z (m), (3,)


class RefereeMemory(NamedTuple):
    """What the referee remembers: numbers only, so that a step copies no objects."""

    time: float  #: of the last update (s)
    airborne: float  #: whether the drone has taken off
    crossings: float  #: number of gates that counted
    max_speed: float  #: since the last of them (m/s)
    verdict: float  #: see above
    end_time: float  #: when the race ended, or now (s)
    touched: float  #: index of what was touched
    position: np.ndarray  #: p_WB at the last update (m), (3,)
    impulse: np.ndarray  #: of all contacts until then, (6,)


# Nothing is crossed before the second update.
_START = RefereeMemory(*7 * [0.0], np.full(3, np.nan), np.zeros(6))  # type: ignore[arg-type, call-arg]


_PACKING = Packing(RefereeMemory, position=3, impulse=6)
_as_memory, _memory_vector = _PACKING.parts, _PACKING.vector


class Referee(LeafSystem):
    """Judges a race.

    .. pydrake_system::

        name: Referee
        input_ports:
        - state
        - contact_results
        - contact_impulse
        - geometry_query
        - explorer_status
        - gate_shifts (only if gates move)
        output_ports:
        - referee_status

    ``state`` is the plant's floating-base state (13), ``contact_results``
    the plant's, ``contact_impulse`` the sum over all of its steps of the generalized
    contact force on the drone (6), ``geometry_query`` SceneGraph's,
    ``explorer_status`` the autonomy's ExplorerStatus: laps count
    from the moment it says that the exploration is done. ``referee_status`` is a
    RefereeStatus. ``gate_shifts`` (2 n) is where the gates stand, see GateMover.

    A gate counts when the body's origin crosses its opening from the front, in racing
    order. A lap runs from gate 1 to gate 1; a course that is not closed is flown once, to
    its last gate. Any contact after
    take-off, leaving the arena, or the time limit ends the race; on the pad,
    only contact with something else than the ground does. A drone that lands because it
    does not know where it is, see Explorer, has not finished, but not collided either.

    The referee is updated less often than the plant: if the impulse has changed since the
    last update, there was a contact in between, even if it lasted one step. What is
    nearest then is what was touched.
    """

    def __init__(
        self,
        *,
        track: Course,
        laps: int,
        period: float,
        time_limit: float,
        arena_margin: float,
        standing_height: float,
        body_names: dict,
        rotor_failures: Iterable = (),
        moving_gates: bool = False,
        contacts_end: bool = True,
    ):
        """Constructs the referee.

        Args:
            track: with the true gates.
            laps: to fly.
            period: of updates (s).
            time_limit: for the whole race (s).
            arena_margin: how far beyond the course's outline, and above the
                ground, the arena reaches (m).
            standing_height: of the body's origin when the drone stands on its
                pad (m).
            body_names: geometry IDs to the names used in a reason, of all that is not the drone's.
            rotor_failures: the scenario's, named in the reason of a crash.
            moving_gates: whether the gates move.
            contacts_end: whether a contact ends the race; if not, somebody else counts them.
        """
        LeafSystem.__init__(self)
        arena_min, arena_max = track.arena(arena_margin)
        self._criteria = Criteria(
            gates=track.openings(),
            take_off_height=standing_height + TAKE_OFF,
            time_limit=float(time_limit),
            arena_min=arena_min,
            arena_max=arena_max,
        )
        self._names = body_names
        self._failures = rotor_failures
        self._touchable = sorted(set(body_names.values()) - set(FLOOR))
        self._total = laps * len(track.gates) + 1 if track.closed else len(track.gates)
        self._contacts_end = contacts_end
        self._state = self.DeclareVectorInputPort("state", 13)
        self._contacts = self.DeclareAbstractInputPort("contact_results", Value(ContactResults()))
        self._impulse = self.DeclareVectorInputPort("contact_impulse", 6)
        self._query = self.DeclareAbstractInputPort("geometry_query", Value(QueryObject()))
        self._explorer = self.DeclareAbstractInputPort(
            "explorer_status", Value[object](ExplorerStatus())
        )
        self._shifts, self._stay = None, np.zeros(2 * len(track.gates))
        if moving_gates:
            self._shifts = self.DeclareVectorInputPort("gate_shifts", 2 * len(track.gates))
        self._memory = self.DeclareDiscreteState(_memory_vector(_START))
        self._table = self.DeclareDiscreteState(3 * self._total)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._judge)
        self.DeclareAbstractOutputPort(
            "referee_status",
            lambda: Value[object](RefereeStatus((), False, None, None, 0)),
            self._calc_status,
            {self.xd_ticket(), self._explorer.ticket()},
        )

    def _judge(self, context, discrete_state):
        memory = discrete_state.get_mutable_value(self._memory)
        shifts = self._stay if self._shifts is None else read_vector(self._shifts, context)
        crossing, offset, pushed, verdict = _observe(
            memory,
            context.get_time(),
            read_vector(self._state, context),
            read_vector(self._impulse, context),
            shifts,
            tuple(self._criteria),
        )
        if crossing < 0.0 and not pushed and verdict == UNDECIDED:
            return
        m, name = _as_memory(memory), None
        if pushed and verdict != DIVERGED and self._contacts_end:
            name = self._touched(context, m.airborne)
            if not m.airborne and self._explorer.Eval(context).state == LAND:
                name = FLOOR[0]  # it will not take off any more
        # What was touched since the last update is held to have come before a gate.
        if name in FLOOR:
            lands = self._explorer.Eval(context).state == LAND
            m = m._replace(verdict=LANDED if lands else GROUND)
        elif name is not None:
            m = m._replace(verdict=TOUCHED, touched=self._touchable.index(name))
        elif crossing >= 0.0 and self._explorer.Eval(context).done:
            row = 3 * int(m.crossings)
            table = discrete_state.get_mutable_value(self._table)
            table[row : row + 3] = crossing, offset, m.max_speed
            m = m._replace(crossings=m.crossings + 1, max_speed=0.0)
            if m.crossings == self._total:
                m = m._replace(verdict=FINISHED, end_time=crossing)
        elif verdict == UNDECIDED:
            return
        if m.verdict == UNDECIDED:
            m = m._replace(verdict=verdict)
        memory[:] = _memory_vector(m)

    def _touched(self, context: Context, airborne: bool) -> str | None:
        """Returns the name of what pushed the drone, now or between two updates."""
        contacts, query = self._contacts.Eval(context), self._query.Eval(context)
        return nearest_name(contacts, query, self._names, airborne)

    def _calc_status(self, context, output):
        m = _as_memory(context.get_discrete_state(self._memory).value())
        table = context.get_discrete_state(self._table).value()
        verdict, reason = int(m.verdict), None
        if verdict in _REASONS:
            reason = _REASONS[verdict]
            if verdict == TOUCHED:
                reason = reason.format(what=self._touchable[int(m.touched)])
            if verdict in (GROUND, TOUCHED, ARENA):
                reason += failures_clause(self._failures, m.end_time)
        if verdict not in (UNDECIDED, FINISHED):
            reason = _with_landing(reason, self._explorer.Eval(context), bool(m.airborne))
        output.set_value(
            RefereeStatus(
                crossings=_crossings(table[: 3 * int(m.crossings)].tobytes(), len(self._stay) // 2),
                finished=verdict == FINISHED,
                dnf_reason=reason,
                end_time=float(m.end_time) if verdict else None,
                collisions=int(verdict in (GROUND, TOUCHED)),
            )
        )


def _with_landing(reason: str | None, explorer: ExplorerStatus, airborne: bool) -> str | None:
    """Returns why a race ended, with why the drone was to land, if it was."""
    if explorer.state != LAND:
        return reason
    lost = f"the drone gave up at {explorer.since:.1f} s ({explorer.reason})"
    if reason is not None:
        return f"{reason}: {lost}"
    return f"{lost}, and {'came down' if airborne else 'stayed on its pad'}"


@functools.lru_cache(maxsize=4)  # the status is evaluated far more often than gates are crossed
def _crossings(table: bytes, gates: int) -> tuple:
    """Returns the GateCrossings of the rows of a table, on a track of so many gates."""
    return tuple(
        GateCrossing(
            time=time, gate=i % gates + 1, lap=i // gates + 1, offset=offset, max_speed=max_speed
        )
        for i, (time, offset, max_speed) in enumerate(np.frombuffer(table).reshape(-1, 3).tolist())
    )


@compiled
def _observe(memory, time, state, impulse, shifts, criteria):
    """Updates the memory with what is seen of the drone.

    Args:
        memory: vector of a RefereeMemory, (16,); changed.
        time: (s).
        state, impulse: see Referee.
        shifts: of the gates, (2 n,) m.
        criteria: Criteria, as a tuple.

    Returns:
        when the drone crossed the next gate since the last update (s), -1 if it did not; how
        far from the midpoint (m); whether it was pushed since then; and the verdict on its
        place and the time. After a verdict, nothing is seen any more.
    """
    m, state, criteria = _as_memory(memory), as_plant_state(state), Criteria(*criteria)
    if m.verdict != UNDECIDED:
        return -1.0, 0.0, False, UNDECIDED
    p, v = state.position, state.velocity
    airborne = 1.0 if p[2] > criteria.take_off_height else m.airborne
    crossing, offset = -1.0, 0.0
    if airborne:
        gate = int(m.crossings) % len(criteria.gates)
        opening = criteria.gates[gate].copy()
        opening[:2] += shifts[2 * gate : 2 * gate + 2]
        share, offset = find(opening, m.position, p)
        if not math.isnan(share):
            crossing = m.time + share * (time - m.time)
    pushed = np.any(impulse != m.impulse)
    max_speed = max(m.max_speed, math.sqrt(dot(v, v)))
    after = RefereeMemory(time, airborne, m.crossings, max_speed, UNDECIDED, time, 0.0, p, impulse)
    assign(memory, _memory_vector(after))
    verdict = TIMEOUT if time >= criteria.time_limit else UNDECIDED
    if not (np.all(p[:2] > criteria.arena_min) and np.all(p < criteria.arena_max)):
        verdict = ARENA if math.isfinite(np.sum(p)) else DIVERGED
    return crossing, offset, pushed, verdict
