import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.trajopt.body_frames import SPACING, body_frames
from airrace.visualization.plan_visualizer import PlanVisualizer
from tests.visualization.meshcat_tools import drawn, fix, plan


@pytest.fixture
def show(meshcat):
    """Draws plans one after the other."""
    visualizer = PlanVisualizer(meshcat=meshcat)
    context = visualizer.CreateDefaultContext()

    def show(*plans):
        for each in plans:
            fix(visualizer, context, lap_plan=each)
            Simulator(visualizer, context.Clone()).AdvanceTo(0.05)

    return show


def test_nothing_is_drawn_before_there_is_a_plan(meshcat, show):
    show(NO_PLAN)
    assert not meshcat.HasPath("plans")


def test_arrows_stand_along_the_plan(meshcat, show):
    show(plan(1))
    circuit = plan(1).circuit
    frames = body_frames(circuit.sample(np.linspace(0.0, circuit.duration, 1000)))
    geometry = drawn(meshcat, "plans/lap_1")["object"]["geometries"][0]["data"]
    array = geometry["attributes"]["position"]["array"]
    vertices = np.frombuffer(array, np.float32).reshape(-1, 3)
    # Two arrows of ten vertices every three metres; an arrow's foot is where the drone is.
    n = frames.positions.shape[1]
    assert n == pytest.approx(40.0 / SPACING, abs=1.0) and len(vertices) == 20 * n
    feet = vertices.reshape(2, n, 10, 3)[:, :, :3].mean(axis=2)
    np.testing.assert_allclose(feet[0], frames.positions.T, atol=0.05)
    np.testing.assert_allclose(feet[1], feet[0], atol=1e-5)


def test_every_plan_has_arrows_of_its_own(meshcat, show):
    show(plan(1), plan(1), plan(3))
    assert [meshcat.HasPath(f"plans/lap_{lap}") for lap in (1, 2, 3)] == [True, False, True]
