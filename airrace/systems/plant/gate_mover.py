"""Moves the gates between laps."""

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from pydrake.systems.framework import BasicVector, Context

from airrace.common.packing import Packing
from airrace.math.random import make_generator
from airrace.rendering.scene.scenery import move_gates
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.plant.drawn_body import CALL_MONITOR
from airrace.systems.seed import declare_seed
from airrace.track import Course
from airrace.track.gate_opening import find
from airrace.vehicle.state import as_plant_state

if TYPE_CHECKING:
    from pydrake.multibody.plant import MultibodyPlant

PERIOD = 0.01  # s, between two updates
_PATIENCE = 0.2  # s, in which a monitor has moved the bodies
_FAR = 20.0  # m, from the drone to a gate that may move


class GateMoverMemory(NamedTuple):
    """What the mover remembers."""

    passages: float  #: number of gates that the drone has passed
    position: np.ndarray  #: p_WB at the last update (m), (3,)
    moved: np.ndarray  #: after which of its passages each gate moved last, from 1, (n,)
    moved_at: float  #: when one moved last (s)


_PACKING = Packing(GateMoverMemory, position=3, moved=-1)
_as_memory, _memory_vector = _PACKING.parts, _PACKING.vector


class GateMover(LeafSystem):
    """Moves every gate once between two passages of the drone.

    .. pydrake_system::

        name: GateMover
        input_ports:
        - state
        - seed (may be left open)
        output_ports:
        - gate_shifts

    ``state`` is the plant's floating-base state (13). ``gate_shifts`` (2 n) is how
    far each gate has moved from its place in the track's file, x and y of gate 1,
    then of gate 2 and so on (m, world); the headings stay. ``seed``: see SeedSource.

    It follows the drone from gate to gate, from the exploration on. When the drone
    passes a gate, the one half a lap back moves, at once or when it is 20 m away:
    no gate moves before it was passed, nor when the drone is near it, and every
    gate is somewhere else when it is passed again. The new place is uniform among
    those that are within ``max_shift`` of the place in the file and of the last one.

    Where bodies are is a parameter in the Context of the plant, which no system may write:
    MakeMonitor() does, by set_bodies(). The parameter 0 here is how far they have been moved,
    (2 n,); it is an error if they stay behind.
    """

    def __init__(self, *, track: Course, max_shift: float, seed: int = 0):
        """Constructs the mover.

        Args:
            track: the gates, where they stand first.
            max_shift: see above (m).
            seed: of the new places, if the port is left open.
        """
        LeafSystem.__init__(self)
        self._openings = track.openings()
        self._max_shift = max_shift
        self._seed = declare_seed(self, seed)
        n = len(track.gates)
        memory = GateMoverMemory(0.0, np.full(3, np.nan), np.zeros(n), 0.0)
        self._applied = self.DeclareNumericParameter(BasicVector(np.zeros(2 * n)))
        self._memory = self.DeclareDiscreteState(_memory_vector(memory))
        self._shifts = self.DeclareDiscreteState(2 * n)
        self._state = self.DeclareVectorInputPort("state", 13)
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, 0.0, self._update)
        self.DeclareStateOutputPort("gate_shifts", self._shifts)

    def _update(self, context, discrete_state):
        memory = _as_memory(context.get_discrete_state(self._memory).value())
        shifts = context.get_discrete_state(self._shifts).value().reshape(-1, 2)
        n, time = len(self._openings), context.get_time()
        if time > memory.moved_at + _PATIENCE:
            self._check_bodies(context, shifts)
        p = as_plant_state(self._state.Eval(context)).position
        gate, passages = int(memory.passages) % n, memory.passages
        opening = self._openings[gate].copy()
        opening[:2] += shifts[gate]
        if not math.isnan(find(opening, memory.position, p)[0]):
            passages += 1
        # How often each gate has been passed and left half a lap behind.
        due = (passages - 1 - n // 2 - np.arange(n)) // n + 1
        late = np.flatnonzero(due > memory.moved)
        moved, moved_at = memory.moved.copy(), memory.moved_at
        if len(late):
            distances = np.hypot(*(self._openings[:, :2] + shifts - p[:2]).T)
            shifts = shifts.copy()
            for gate in late[distances[late] > _FAR]:
                moved[gate], moved_at = due[gate], time
                shifts[gate] = self._next_shift(
                    shifts[gate], self._seed(context), gate, int(due[gate])
                )
            discrete_state.set_value(self._shifts, shifts.ravel())
        after = GateMoverMemory(passages, p, moved, moved_at)
        discrete_state.set_value(self._memory, _memory_vector(after))

    def set_bodies(self, context: Context, plant: "MultibodyPlant", plant_context: Context) -> None:
        """Moves the bodies of the gates in a plant to where they are in this system's context."""
        shifts = context.get_discrete_state(self._shifts).value()
        # To write is to compute everything anew that depends on it.
        if not np.array_equal(context.get_numeric_parameter(self._applied).value(), shifts):
            move_gates(plant, plant_context, shifts.reshape(-1, 2))
            context.get_mutable_numeric_parameter(self._applied).SetFromVector(shifts)

    def _check_bodies(self, context, shifts):
        if not np.array_equal(context.get_numeric_parameter(self._applied).value(), shifts.ravel()):
            raise RuntimeError(f"The gates have moved, and their bodies have not: {CALL_MONITOR}")

    def _next_shift(self, old: np.ndarray, seed: int, gate: int, passage: int) -> np.ndarray:
        """Returns where a gate moves to after a passage, (2,), from its place in the file."""
        generator = make_generator(seed, f"gate_{gate}", passage)
        while True:
            radius = self._max_shift * math.sqrt(generator.uniform())
            angle = generator.uniform(0.0, 2.0 * math.pi)
            new = radius * np.array([math.cos(angle), math.sin(angle)])
            if np.hypot(*(new - old)) <= self._max_shift:
                return new
