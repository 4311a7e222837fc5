import numpy as np
from pydrake.systems.analysis import Simulator

from airrace.track.gate_map import GateMap, MarkerEstimate
from airrace.visualization.map_visualizer import MAGNIFICATION, MapVisualizer
from tests.visualization.meshcat_tools import fix, transform


def _map(variance, x=10.0):
    marker = MarkerEstimate(
        id=4,
        count=9,
        outliers=0,
        p_WM=np.array([x, 2.0, 3.0]),
        variance=np.array(variance),
        normal=np.array([1.0, 0.0, 0.0]),
    )
    return GateMap(time=1.0, markers=(marker,))


def test_an_ellipsoid_is_as_large_as_what_is_not_known(meshcat):
    visualizer = MapVisualizer(meshcat=meshcat)
    simulator = Simulator(visualizer)
    context = simulator.get_mutable_context()
    fix(visualizer, context, gate_map=GateMap())
    simulator.AdvanceTo(0.05)
    assert not meshcat.HasPath("map")

    fix(visualizer, context, gate_map=_map([4e-4, 1e-4, 0.0]))
    simulator.AdvanceTo(0.55)
    matrix = np.reshape(transform(meshcat, "map/4"), (4, 4)).T
    np.testing.assert_allclose(np.diag(matrix)[:2], MAGNIFICATION * np.array([0.02, 0.01]))
    assert 0.0 < matrix[2, 2] < 0.5  # what is known is still seen
    np.testing.assert_allclose(matrix[:3, 3], [10.0, 2.0, 3.0])

    fix(visualizer, context, gate_map=_map([4e-4, 1e-4, 0.0], x=11.0))
    simulator.AdvanceTo(1.05)
    assert transform(meshcat, "map/4")[12] == 11.0
