import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.trajopt.body_frames import SPACING, body_frames
from airrace.visualization.plan_visualizer import PlanVisualizer
from tests.visualization.meshcat_tools import drawn, fix, plan, property_of


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


def _material(meshcat, path):
    return drawn(meshcat, path)["object"]["materials"][0]


def _vertices(meshcat, path):
    data = drawn(meshcat, path)["object"]["geometries"][0]["data"]["attributes"]["position"]
    return np.frombuffer(data["array"], np.float32).reshape(-1, 3)


def test_nothing_is_drawn_before_there_is_a_plan(meshcat, show):
    show(NO_PLAN)
    assert not meshcat.HasPath("plans")


def test_the_plan_in_force_is_white_with_arrows(meshcat, show):
    show(plan(1))
    assert _material(meshcat, "plans/lap_1/in_force/path")["color"] == 0xFFFFFF
    assert property_of(meshcat, "plans/lap_1/in_force", "visible")
    circuit = plan(1).circuit
    frames = body_frames(circuit.sample(np.linspace(0.0, circuit.duration, 1000)))
    vertices = _vertices(meshcat, "plans/lap_1/in_force/arrows")
    # Two arrows of ten vertices every three metres; an arrow's foot is where the drone is.
    n = frames.positions.shape[1]
    assert n == pytest.approx(40.0 / SPACING, abs=1.0) and len(vertices) == 20 * n
    feet = vertices.reshape(2, n, 10, 3)[:, :, :3].mean(axis=2)
    np.testing.assert_allclose(feet[0], frames.positions.T, atol=0.05)
    np.testing.assert_allclose(feet[1], feet[0], atol=1e-5)


def test_all_earlier_plans_are_orange_and_fade(meshcat, show):
    show(*(plan(lap) for lap in range(1, 31)))
    opacities = []
    for lap in range(1, 30):
        path = f"plans/lap_{lap}"
        material = _material(meshcat, f"{path}/earlier")
        assert material["color"] >> 16 == 0xFF and material["color"] & 0xFF == 0
        opacities.append(property_of(meshcat, f"{path}/earlier", "opacity"))
        assert property_of(meshcat, f"{path}/earlier", "visible")
        assert property_of(meshcat, f"{path}/in_force", "visible") is False
    assert np.all(np.diff(opacities) > 0.0) and 0.02 < opacities[0] and opacities[-1] < 1.0
    assert property_of(meshcat, "plans/lap_30/in_force", "visible")
    assert not meshcat.HasPath("plans/lap_30/earlier")


def test_a_plan_that_comes_again_is_drawn_once(meshcat, show):
    """Several laps fly it; and a link makes another object of it every time."""
    one = plan(1)
    show(one, one, plan(1))
    assert not meshcat.HasPath("plans/lap_1/earlier")


class _Recorder:
    """A Meshcat that writes down what becomes visible when."""

    def __init__(self):
        self.visible = {}

    def SetProperty(self, path, name, value, time=None):
        if name == "visible":
            self.visible.setdefault(path, {})[time] = value

    def SetTriangleMesh(self, *_):
        pass

    SetTriangleColorMesh = SetTriangleMesh


def test_a_replay_shows_a_plan_in_white_while_it_was_in_force():
    meshcat = _Recorder()
    visualizer = PlanVisualizer(meshcat=meshcat)
    simulator = Simulator(visualizer)
    for end, now in ((0.95, NO_PLAN), (1.95, plan(1)), (3.05, plan(2, start_time=2.0))):
        fix(visualizer, simulator.get_mutable_context(), lap_plan=now)
        simulator.AdvanceTo(end)
    times = {
        path: {round(t, 6): v for t, v in each.items()} for path, each in meshcat.visible.items()
    }
    assert times == {
        "plans/lap_1/in_force": {0.0: False, 1.0: True, 2.0: False},
        "plans/lap_1/earlier": {0.0: False, 2.0: True},
        "plans/lap_2/in_force": {0.0: False, 2.0: True},
    }
