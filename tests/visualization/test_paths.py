import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from airrace.systems.planning.lap_plan import NO_PLAN, LapPlan
from airrace.visualization.paths import PathVisualizer, PlanVisualizer
from tests.visualization.meshcat_tools import Watching, drawn, fix


def test_draws_the_flown_path_in_pieces(meshcat):
    paths = PathVisualizer(meshcat=meshcat)
    simulator = Simulator(paths)
    fix(paths, simulator.get_mutable_context(), truth__state=np.zeros(13))
    simulator.AdvanceTo(2.95)
    assert meshcat.HasPath("here") and not meshcat.HasPath("flown")
    simulator.AdvanceTo(4.05)
    assert meshcat.HasPath("flown/0") and not meshcat.HasPath("flown/1")
    paths.ForcedPublish(simulator.get_context())
    assert meshcat.HasPath("flown/1") and not meshcat.HasPath("flown/2")


def test_who_looks_sees_the_path_grow(meshcat):
    paths = PathVisualizer(meshcat=meshcat, audience=Watching())
    simulator = Simulator(paths)
    fix(paths, simulator.get_mutable_context(), truth__state=np.zeros(13))
    for end, count in ((0.15, 2), (1.05, 11), (3.05, 31), (3.15, 2)):
        simulator.AdvanceTo(end)
        piece = drawn(meshcat, f"flown/{int(end > 3.1)}")["object"]["geometries"][0]
        positions = np.frombuffer(piece["data"]["attributes"]["position"]["array"], np.float32)
        assert len(positions) == 3 * 3 * count


def test_the_path_is_coloured_by_speed(meshcat):
    colors = []
    for speed in (0.0, 20.0):
        paths = PathVisualizer(meshcat=meshcat, audience=Watching())
        simulator = Simulator(paths)
        state = np.zeros(13)
        state[10] = speed
        fix(paths, simulator.get_mutable_context(), truth__state=state)
        simulator.AdvanceTo(0.25)
        geometry = drawn(meshcat, "flown/0")["object"]["geometries"][0]
        data = geometry["data"]["attributes"]["color"]["array"]
        colors.append(np.frombuffer(data, np.float32)[:3])
    assert colors[0][2] > colors[0][0] and colors[1][0] > colors[1][2]


class _Line:
    """A way straight ahead, for plans."""

    duration = 2.0

    def sample(self, times):
        return np.array([times, 0 * times, 0 * times, 0 * times])


def _plan(lap):
    return LapPlan(lap=lap, start_time=0.0, entry=_Line(), circuit=_Line(), phase=0.0, summary=None)


@pytest.fixture
def plans(meshcat):
    """Draws plans one after the other."""
    visualizer = PlanVisualizer(meshcat=meshcat)
    context = visualizer.CreateDefaultContext()

    def draw(plan):
        fix(visualizer, context, lap_plan=plan)
        simulator = Simulator(visualizer, context.Clone())
        simulator.AdvanceTo(0.05)

    return draw


def _material(meshcat, number):
    return drawn(meshcat, f"planned/{number}/circuit")["object"]["materials"][0]


def test_nothing_is_drawn_before_there_is_a_plan(meshcat, plans):
    plans(NO_PLAN)
    assert not meshcat.HasPath("planned")


def test_earlier_plans_are_orange_and_fade(meshcat, plans):
    for lap in range(1, 8):
        plans(_plan(lap))
    assert _material(meshcat, 7)["color"] == 0xFFFFFF
    opacities = []
    for number in (6, 5, 4, 3):
        material = _material(meshcat, number)
        assert material["color"] >> 16 == 0xFF and material["color"] & 0xFF == 0
        opacities.append(material["opacity"])
    assert opacities == sorted(opacities, reverse=True) and opacities[-1] > 0.0
    assert not meshcat.HasPath("planned/2") and not meshcat.HasPath("planned/1")


def test_a_plan_is_drawn_once(meshcat, plans):
    plan = _plan(1)
    plans(plan)
    plans(plan)
    assert not meshcat.HasPath("planned/2")
