"""The seed of all that is random in a simulation, which a Context holds."""

import struct
import zlib
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from pydrake.systems.framework import BasicVector
from pydrake.systems.primitives import LinearSystem

from airrace.math.random import SHORT, short_name
from airrace.systems.leaf_system import LeafSystem

if TYPE_CHECKING:
    from pydrake.systems.framework import Context, DiagramBuilder, OutputPort

_NEVER = 1e9  # s, until the draw is replaced by itself


class SeedSource(LeafSystem):
    """Says which seed a Context has: by default the scenario's.

    .. pydrake_system::

        name: SeedSource
        input_ports:
        - draw
        output_ports:
        - seed

    ``draw`` is a number that SetRandomContext() draws, and SetDefaultContext() makes zero again.
    While it is zero, ``seed`` is the parameter 0 of this system: the scenario's seed, until you
    write another one into a Context. Else it follows from the draw. (In Python a system can't
    override SetRandomParameters(), so the draw is the state of a LinearSystem.) A number of Drake's
    holds 53 bits: a longer seed is there by its short_name().
    """

    def __init__(self, seed: int):
        """Args: seed: of the scenario."""
        LeafSystem.__init__(self)
        self._seed = self.DeclareNumericParameter(BasicVector([seed]))
        self._draw = self.DeclareVectorInputPort("draw", 1)
        # Not of time: it is read by rotors hundreds of times a second.
        tickets = {self.all_parameters_ticket(), self.all_input_ports_ticket()}
        self.DeclareVectorOutputPort("seed", 1, self._calc_seed, tickets)

    def _calc_seed(self, context, output):
        (draw,) = self._draw.Eval(context)
        seed = context.get_numeric_parameter(self._seed)[0]
        if not 0.0 <= seed <= SHORT or seed != int(seed):
            raise ValueError(f"The seed of a simulation must be a whole number >= 0, not {seed}.")
        output.SetAtIndex(0, zlib.crc32(struct.pack("d", draw)) if draw else seed)


def AddSeedSource(builder: "DiagramBuilder", seed: int) -> "OutputPort":
    """Adds a SeedSource with a scenario's seed, and what draws others; returns its port."""
    one, none = np.eye(1), np.zeros((1, 0))
    draw = LinearSystem(one, none, one, none, _NEVER)
    draw.configure_random_state(one)
    builder.AddNamedSystem("seed_draw", draw)
    source = builder.AddNamedSystem("seed_source", SeedSource(short_name(seed)))
    builder.Connect(draw.get_output_port(), source.GetInputPort("draw"))
    return source.GetOutputPort("seed")


def declare_seed(system: LeafSystem, default: int) -> "Callable[[Context], int]":
    """Declares the input port ``seed`` (1) of a system, which may be left open.

    Args:
        system: the system.
        default: the seed if nothing is connected.

    Returns:
        a function of the system's Context, which returns the seed.
    """
    port = system.DeclareVectorInputPort("seed", 1)

    def seed(context):
        return int(port.EvalBasicVector(context)[0]) if port.HasValue(context) else default

    return seed
