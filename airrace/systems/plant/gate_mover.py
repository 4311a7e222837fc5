"""Moves the gates between laps."""

import math

import numpy as np
from pydrake.systems.framework import LeafSystem

from airrace.math.random import make_generator
from airrace.track import Track
from airrace.track.gate_opening import GateOpening

PERIOD = 0.01  # s, between two looks at the drone
_FAR = 20.0  # m, from the drone to a gate that may move


class GateMover(LeafSystem):
    """Moves every gate once between two passages of the drone.

    .. pydrake_system::

        name: GateMover
        input_ports:
        - state
        output_ports:
        - gate_shifts

    ``state`` is the plant's floating-body state (13). ``gate_shifts`` (2 n) is how
    far each gate has moved from its place in the track's file, x and y of gate 1,
    then of gate 2 and so on (m, world); the headings stay.

    It follows the drone from gate to gate, from the exploration on. When the drone
    passes a gate, the one half a lap back moves, at once or when it is 20 m away:
    no gate moves before it was passed, nor when the drone is near it, and every
    gate is somewhere else when it is passed again. The new place is uniform among
    those that are within ``max_shift`` of the place in the file and of the last one.
    """

    def __init__(self, *, track: Track, max_shift: float, seed: int):
        """Constructs the mover.

        Args:
            track: the gates, where they stand first.
            max_shift: see above (m).
            seed: of the new places.
        """
        LeafSystem.__init__(self)
        self._openings = [GateOpening(gate) for gate in track.gates]
        self._places = np.array([gate.p_WG[:2] for gate in track.gates])
        self._max_shift = max_shift
        self._seed = seed
        n = len(track.gates)
        # Where the drone was, how many gates it has passed, and for each gate for
        # which passage it moved last.
        self._memory = self.DeclareDiscreteState([math.nan] * 3 + [0.0] * (1 + n))
        self._shifts = self.DeclareDiscreteState(2 * n)
        self._state = self.DeclareVectorInputPort("state", 13)
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, 0.0, self._update)
        self.DeclareStateOutputPort("gate_shifts", self._shifts)

    def _update(self, context, discrete_state):
        memory = context.get_discrete_state(self._memory).value().copy()
        shifts = context.get_discrete_state(self._shifts).value().reshape(-1, 2)
        n = len(self._openings)
        p = self._state.Eval(context)[4:7]
        gate = int(memory[3]) % n
        if self._openings[gate].find(memory[:3], p, shifts[gate]):
            memory[3] += 1
        memory[:3] = p
        # How often each gate has been passed and left half a lap behind.
        due = (memory[3] - 1 - n // 2 - np.arange(n)) // n + 1
        late = np.flatnonzero(due > memory[4:])
        if len(late):
            distances = np.hypot(*(self._places + shifts - p[:2]).T)
            for gate in late[distances[late] > _FAR]:
                memory[4 + gate] = due[gate]
                shifts = shifts.copy()
                shifts[gate] = self._next_shift(shifts[gate], gate, int(due[gate]))
            discrete_state.set_value(self._shifts, shifts.ravel())
        discrete_state.set_value(self._memory, memory)

    def _next_shift(self, old, gate, passage) -> np.ndarray:
        """Returns where a gate moves to after a passage, (2,), from its place in the file."""
        generator = make_generator(self._seed, f"gate_{gate}", passage)
        while True:
            radius = self._max_shift * math.sqrt(generator.uniform())
            angle = generator.uniform(0.0, 2.0 * math.pi)
            new = radius * np.array([math.cos(angle), math.sin(angle)])
            if np.hypot(*(new - old)) <= self._max_shift:
                return new
