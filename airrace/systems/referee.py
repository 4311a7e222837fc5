"""The referee: counts gates and laps, and ends the race, on truth."""

import functools
import math

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import QueryObject
from pydrake.multibody.plant import ContactResults
from pydrake.systems.framework import LeafSystem

from airrace.common.jit import compilable, compiled
from airrace.systems.ports import read_vector
from airrace.systems.referee_status import (
    ARENA,
    DIVERGED,
    FINISHED,
    GROUND,
    TIMEOUT,
    TOUCHED,
    VERDICTS,
    GateCrossing,
    RefereeStatus,
)
from airrace.systems.types import ExplorerStatus
from airrace.track import Track
from airrace.track.gate_opening import GateOpening, find
from airrace.vehicle.disturbances import failures_clause

# Columns of the table of crossings.
_TIME, _OFFSET, _MAX_SPEED = range(3)
# The memory: when and where the last look was, whether the drone has taken off, how many
# gates it has crossed, its greatest speed since the last of them, the verdict, the index of
# what it touched, when the race ended, and the impulse of all contacts up to the last look.
_LOOK, _PLACE, _AIRBORNE, _CROSSINGS, _FASTEST = 0, slice(1, 4), 4, 5, 6
_VERDICT, _THING, _END, _IMPULSE = 7, 8, 9, slice(10, 16)
_BEFORE = np.array([0.0, *3 * [np.nan], *12 * [0.0]])  # no crossing before the second look
_POSITION = slice(4, 7)  # in the plant's state
_FLOOR = ("ground", "pad")
_OVER = -1  # there is a verdict already


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
        - report

    ``state`` is the plant's floating-body state (13), ``contact_results``
    the plant's, ``contact_impulse`` the sum over all of its steps of the generalized
    contact force on the drone (6), ``geometry_query`` SceneGraph's,
    ``explorer_status`` the autonomy's ExplorerStatus: laps count
    from the moment it says that the exploration is done. ``report`` is a
    RefereeStatus. ``gate_shifts`` (2 n) is where the gates stand, see GateMover.

    A gate counts when the body's origin crosses the rectangle between the
    two pylon axes, from the front, above the ground and below the pylons'
    tips, in racing order. A lap runs from gate 1 to gate 1. Any contact after
    take-off, leaving the arena, or the time limit ends the race; on the pad,
    only contact with something else than the ground does. The referee looks less
    often than the plant steps: that the impulse is another than at the last look
    tells it of a touch in between, even of a single step. What is nearest then is
    what was touched.
    """

    def __init__(
        self,
        *,
        track: Track,
        laps: int,
        period: float,
        time_limit: float,
        arena_margin: float,
        standing_height: float,
        body_names: dict,
        rotor_failures=(),
        moving_gates: bool = False,
    ):
        """Constructs the referee.

        Args:
            track: with the true gates.
            laps: to fly.
            period: between looks (s).
            time_limit: for the whole race (s).
            arena_margin: how far beyond the outermost pylons, and above the
                ground, the arena reaches (m).
            standing_height: of the body's origin when the drone stands on its
                pad (m).
            body_names: geometry IDs to the names used in a reason.
            rotor_failures: the scenario's, named in the reason of a crash.
            moving_gates: whether the gates move.
        """
        LeafSystem.__init__(self)
        self._gates = np.array([GateOpening(gate).numbers for gate in track.gates])
        feet = track.pylons()[:, :2]
        self._bounds = np.array(
            [
                standing_height + 0.4,
                time_limit,
                *(feet.min(0) - arena_margin),
                *(feet.max(0) + arena_margin),
                arena_margin,
            ]
        )
        self._names = body_names
        self._failures = rotor_failures
        self._touchable = sorted(set(body_names.values()) - set(_FLOOR))
        self._total = laps * len(track.gates) + 1
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
        # Numbers only, so that a step copies no objects.
        self._memory = self.DeclareDiscreteState(_BEFORE)
        self._table = self.DeclareDiscreteState(3 * self._total)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._judge)
        self.DeclareAbstractOutputPort(
            "report",
            lambda: Value[object](RefereeStatus((), False, None, None, 0)),
            self._calc_report,
            {self.xd_ticket()},
        )

    def _judge(self, context, discrete_state):
        m = discrete_state.get_mutable_value(self._memory)
        shifts = self._stay if self._shifts is None else read_vector(self._shifts, context)
        crossing, offset, pushed, where = _look(
            m,
            context.get_time(),
            read_vector(self._state, context),
            read_vector(self._impulse, context),
            self._gates,
            shifts,
            self._bounds,
        )
        if where == _OVER:
            return
        # What it touched since the last look is held to have come before a gate.
        name = None
        if pushed and where != DIVERGED:
            name = self._touched(context, m[_AIRBORNE])
        if name in _FLOOR:
            m[_VERDICT] = GROUND
        elif name is not None:
            m[_VERDICT], m[_THING] = TOUCHED, self._touchable.index(name)
        elif crossing >= 0.0 and self._explorer.Eval(context).done:
            row = 3 * int(m[_CROSSINGS])
            discrete_state.get_mutable_value(self._table)[row : row + 3] = (
                crossing,
                offset,
                m[_FASTEST],
            )
            m[_CROSSINGS] += 1
            m[_FASTEST] = 0.0
            if m[_CROSSINGS] == self._total:
                m[_VERDICT], m[_END] = FINISHED, crossing
        if m[_VERDICT] == 0.0:
            m[_VERDICT] = where

    def _touched(self, context, airborne) -> str | None:
        """Returns the name of what pushed the drone, now or between two looks."""
        contacts = self._contacts.Eval(context)
        pairs = [
            contacts.point_pair_contact_info(i).point_pair()
            for i in range(contacts.num_point_pair_contacts())
        ]
        if airborne and not pairs:
            distances = self._query.Eval(context).ComputeSignedDistancePairwiseClosestPoints()
            pairs = sorted(distances, key=lambda pair: pair.distance)
        for pair in pairs:
            name = self._names.get(pair.id_A) or self._names.get(pair.id_B)
            if name and (airborne or name not in _FLOOR):
                return name
        return None

    def _calc_report(self, context, output):
        m = context.get_discrete_state(self._memory).value()
        table = context.get_discrete_state(self._table).value()
        crossings = _crossings(table[: 3 * int(m[_CROSSINGS])].tobytes(), len(self._gates))
        verdict = int(m[_VERDICT])
        reason = None
        end_time = float(m[_END])
        if verdict > FINISHED:
            what = self._touchable[int(m[_THING])] if verdict == TOUCHED else ""
            reason = VERDICTS[verdict].format(what=what)
            if verdict in (GROUND, TOUCHED, ARENA):
                reason += failures_clause(self._failures, end_time)
        output.set_value(
            RefereeStatus(
                crossings=crossings,
                finished=verdict == FINISHED,
                dnf_reason=reason,
                end_time=end_time if verdict else None,
                collisions=int(verdict in (GROUND, TOUCHED)),
            )
        )


@functools.lru_cache(maxsize=4)  # asked for again and again, while there is no new one
def _crossings(table: bytes, gates: int) -> tuple:
    """Returns the GateCrossings of the rows of a table, on a track of so many gates."""
    return tuple(
        GateCrossing(
            time=row[_TIME],
            gate=i % gates + 1,
            lap=i // gates + 1,
            offset=row[_OFFSET],
            max_speed=row[_MAX_SPEED],
        )
        for i, row in enumerate(np.frombuffer(table).reshape(-1, 3).tolist())
    )


@compiled
def _look(m, time, state, impulse, gates, shifts, bounds):
    """Notes in the memory what can be seen of the drone, unless the race is over.

    Args:
        m: the memory. time: (s). state, impulse: see Referee.
        gates: see GateOpening, (n, 10).
        shifts: of those, (2 n,) m.
        bounds: the height at which it has taken off, the time limit, and the arena: least x
            and y, greatest x, y and z.

    Returns:
        when it crossed the next gate since the look before (s), -1 if it did not; how far
        from the midpoint (m); whether it was pushed since then; and the verdict on where
        and when it is, or _OVER.
    """
    if m[_VERDICT] != 0.0:
        return -1.0, 0.0, False, _OVER
    p = state[_POSITION]
    m[_END] = time
    if p[2] > bounds[0]:
        m[_AIRBORNE] = 1.0
    x, y, z = state[-3:]
    m[_FASTEST] = max(m[_FASTEST], math.sqrt(x * x + y * y + z * z))
    crossing, offset = -1.0, 0.0
    if m[_AIRBORNE]:
        gate = int(m[_CROSSINGS]) % len(gates)
        share, offset = find(gates[gate], m[_PLACE], p, shifts[2 * gate], shifts[2 * gate + 1])
        if not math.isnan(share):
            crossing = m[_LOOK] + share * (time - m[_LOOK])
    pushed = False
    for i in range(len(impulse)):
        pushed = pushed or impulse[i] != m[_IMPULSE.start + i]
    m[_LOOK], m[_PLACE], m[_IMPULSE] = time, p, impulse
    return crossing, offset, pushed, _whereabouts(p, time, bounds)


@compilable
def _whereabouts(p, time, bounds):
    """Returns a verdict on where and when the drone is, 0 if it is fine."""
    x, y, z = p
    if not math.isfinite(x + y + z):
        return DIVERGED
    _, limit, x0, y0, x1, y1, z1 = bounds
    if not (x0 < x < x1 and y0 < y < y1 and z < z1):
        return ARENA
    return TIMEOUT if time >= limit else 0
