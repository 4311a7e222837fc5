"""Mass and moments of inertia that follow from the seed of a Context."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from pydrake.multibody.tree import RotationalInertia, SpatialInertia
from pydrake.systems.framework import BasicVector

from airrace.math.random import short_name
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.seed import declare_seed

if TYPE_CHECKING:
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import BodyIndex
    from pydrake.systems.framework import Context

    from airrace.vehicle import Vehicle

# What to do where a plant does not have what a system has drawn.
CALL_MONITOR = "call simulator.set_monitor(airrace.diagrams.simulation.MakeMonitor(diagram))."
_FIRST, _PERIOD = 0.01, 0.2  # s, of looks whether a monitor has obeyed


class DrawnBody(LeafSystem):
    """Gives a drone's body the mass and inertia that are drawn by a seed.

    .. pydrake_system::

        name: DrawnBody
        input_ports:
        - seed

    The plant is made with those of the scenario's seed. Those of another one are parameters in its
    Context, which no system may write: MakeMonitor() does, by set_bodies(). The parameter 0 here
    is the seed whose body the plant has; that it stays another one than ``seed`` is an error.
    """

    def __init__(self, *, body: "BodyIndex", drawn: "Callable[[int], Vehicle]", seed: int):
        """Constructs the system.

        Args:
            body: of the drone.
            drawn: from a seed to the drone as it is.
            seed: that the plant was made with.
        """
        LeafSystem.__init__(self)
        self._body, self._drawn = body, drawn
        self._seed = declare_seed(self, seed)
        self._applied = self.DeclareNumericParameter(BasicVector([short_name(seed)]))
        self.DeclarePeriodicPublishEvent(_PERIOD, _FIRST, self._check)

    def set_bodies(
        self, context: "Context", plant: "MultibodyPlant", plant_context: "Context"
    ) -> None:
        """Gives the body what the seed of this system's context says."""
        seed, applied = self._seed(context), context.get_numeric_parameter(self._applied)
        if seed != applied[0]:
            vehicle = self._drawn(seed)
            inertia = RotationalInertia(*vehicle.inertia)
            M = SpatialInertia.MakeFromCentralInertia(vehicle.mass, np.zeros(3), inertia)
            plant.get_body(self._body).SetSpatialInertiaInBodyFrame(plant_context, M)
            context.get_mutable_numeric_parameter(self._applied).SetAtIndex(0, seed)

    def _check(self, context):
        if self._seed(context) != context.get_numeric_parameter(self._applied)[0]:
            raise RuntimeError(
                "The drone's mass and inertia are those of another seed than the Context's: "
                + CALL_MONITOR
            )
