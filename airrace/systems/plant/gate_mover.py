"""Moves the gates between laps."""

import math
from typing import NamedTuple

import numpy as np

from airrace.common.packing import Packing
from airrace.math.random import make_generator
from airrace.systems.leaf_system import LeafSystem
from airrace.track import Course
from airrace.track.gate_opening import find
from airrace.vehicle.state import as_plant_state

PERIOD = 0.01  # s, between two updates
_FAR = 20.0  # m, from the drone to a gate that may move


class GateMoverMemory(NamedTuple):
    """What the mover remembers.

    Attributes:
        passages: number of gates that the drone has passed.
        position: p_WB at the last update (m), (3,).
        moved: after which of its passages each gate moved last, from 1, (n,).
    """

    passages: float
    position: np.ndarray
    moved: np.ndarray


_PACKING = Packing(GateMoverMemory, position=3, moved=-1)
_as_memory, _memory_vector = _PACKING.parts, _PACKING.vector


class GateMover(LeafSystem):
    """Moves every gate once between two passages of the drone.

    .. pydrake_system::

        name: GateMover
        input_ports:
        - state
        output_ports:
        - gate_shifts

    ``state`` is the plant's floating-base state (13). ``gate_shifts`` (2 n) is how
    far each gate has moved from its place in the track's file, x and y of gate 1,
    then of gate 2 and so on (m, world); the headings stay.

    It follows the drone from gate to gate, from the exploration on. When the drone
    passes a gate, the one half a lap back moves, at once or when it is 20 m away:
    no gate moves before it was passed, nor when the drone is near it, and every
    gate is somewhere else when it is passed again. The new place is uniform among
    those that are within ``max_shift`` of the place in the file and of the last one.
    """

    def __init__(self, *, track: Course, max_shift: float, seed: int):
        """Constructs the mover.

        Args:
            track: the gates, where they stand first.
            max_shift: see above (m).
            seed: of the new places.
        """
        LeafSystem.__init__(self)
        self._openings = track.openings()
        self._max_shift = max_shift
        self._seed = seed
        n = len(track.gates)
        memory = GateMoverMemory(0.0, np.full(3, np.nan), np.zeros(n))
        self._memory = self.DeclareDiscreteState(_memory_vector(memory))
        self._shifts = self.DeclareDiscreteState(2 * n)
        self._state = self.DeclareVectorInputPort("state", 13)
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, 0.0, self._update)
        self.DeclareStateOutputPort("gate_shifts", self._shifts)

    def _update(self, context, discrete_state):
        memory = _as_memory(context.get_discrete_state(self._memory).value())
        shifts = context.get_discrete_state(self._shifts).value().reshape(-1, 2)
        n = len(self._openings)
        p = as_plant_state(self._state.Eval(context)).position
        gate, passages = int(memory.passages) % n, memory.passages
        opening = self._openings[gate].copy()
        opening[:2] += shifts[gate]
        if not math.isnan(find(opening, memory.position, p)[0]):
            passages += 1
        # How often each gate has been passed and left half a lap behind.
        due = (passages - 1 - n // 2 - np.arange(n)) // n + 1
        late = np.flatnonzero(due > memory.moved)
        moved = memory.moved.copy()
        if len(late):
            distances = np.hypot(*(self._openings[:, :2] + shifts - p[:2]).T)
            shifts = shifts.copy()
            for gate in late[distances[late] > _FAR]:
                moved[gate] = due[gate]
                shifts[gate] = self._next_shift(shifts[gate], gate, int(due[gate]))
            discrete_state.set_value(self._shifts, shifts.ravel())
        after = GateMoverMemory(passages, p, moved)
        discrete_state.set_value(self._memory, _memory_vector(after))

    def _next_shift(self, old: np.ndarray, gate: int, passage: int) -> np.ndarray:
        """Returns where a gate moves to after a passage, (2,), from its place in the file."""
        generator = make_generator(self._seed, f"gate_{gate}", passage)
        while True:
            radius = self._max_shift * math.sqrt(generator.uniform())
            angle = generator.uniform(0.0, 2.0 * math.pi)
            new = radius * np.array([math.cos(angle), math.sin(angle)])
            if np.hypot(*(new - old)) <= self._max_shift:
                return new
