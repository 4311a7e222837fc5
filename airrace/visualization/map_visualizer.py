"""The map, with what is not known of it."""

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import Meshcat, Rgba, Sphere
from pydrake.systems.framework import LeafSystem

from airrace.track.gate_map import GateMap

# Radii of an ellipsoid in standard deviations, which are millimetres; but the least
# is seen.
MAGNIFICATION = 100.0
_LEAST = 0.15  # m
_COLOR = Rgba(0.85, 0.15, 0.9, 0.45)
_CHANGE = 0.02  # m, of place or radius, that is drawn


class MapVisualizer(LeafSystem):
    """Draws an ellipsoid for each marker of the map, large where it is not sure.

    .. pydrake_system::

        name: MapVisualizer
        input_ports:
        - gate_map

    ``gate_map`` is a GateMap. The radii along the world's axes are 100 standard
    deviations, and never less than 15 cm.
    """

    def __init__(self, *, meshcat: Meshcat):
        """Args: meshcat: to draw in."""
        LeafSystem.__init__(self)
        self._meshcat = meshcat
        self._map = self.DeclareAbstractInputPort("gate_map", Value[object](GateMap()))
        self._drawn = {}  # marker ID to place and radii, (6,); see PathVisualizer
        self.DeclarePeriodicPublishEvent(0.5, 0.0, self._draw)

    def _draw(self, context):
        for marker in self._map.Eval(context).markers:
            radii = np.maximum(MAGNIFICATION * np.sqrt(marker.variance), _LEAST)
            shown = np.concatenate([marker.p_WM, radii])
            path = f"map/{marker.id}"
            if marker.id not in self._drawn:
                self._meshcat.SetObject(path, Sphere(1.0), _COLOR)
            elif np.abs(shown - self._drawn[marker.id]).max() < _CHANGE:
                continue
            self._drawn[marker.id] = shown
            X = np.diag([*radii, 1.0])
            X[:3, 3] = marker.p_WM
            self._meshcat.SetTransform(path, X)
