import numpy as np
from pydrake.systems.analysis import Simulator

from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.visualization.paths import PathVisualizer
from tests.visualization.meshcat_tools import Watching, drawn, fix, plan, property_of


def test_draws_the_flown_path_in_pieces(meshcat):
    paths = PathVisualizer(meshcat=meshcat)
    simulator = Simulator(paths)
    fix(paths, simulator.get_mutable_context(), truth__state=np.zeros(13), lap_plan=NO_PLAN)
    simulator.AdvanceTo(2.95)
    assert meshcat.HasPath("here") and not meshcat.HasPath("flown")
    simulator.AdvanceTo(4.05)
    assert meshcat.HasPath("flown/0") and not meshcat.HasPath("flown/1")
    paths.ForcedPublish(simulator.get_context())
    assert meshcat.HasPath("flown/1") and not meshcat.HasPath("flown/2")


def test_who_looks_sees_the_path_grow(meshcat):
    paths = PathVisualizer(meshcat=meshcat, audience=Watching())
    simulator = Simulator(paths)
    fix(paths, simulator.get_mutable_context(), truth__state=np.zeros(13), lap_plan=NO_PLAN)
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
        fix(paths, simulator.get_mutable_context(), truth__state=state, lap_plan=NO_PLAN)
        simulator.AdvanceTo(0.25)
        geometry = drawn(meshcat, "flown/0")["object"]["geometries"][0]
        data = geometry["data"]["attributes"]["color"]["array"]
        colors.append(np.frombuffer(data, np.float32)[:3])
    assert colors[0][2] > colors[0][0] and colors[1][0] > colors[1][2]


def test_all_earlier_laps_are_there_and_the_older_the_fainter(meshcat):
    paths = PathVisualizer(meshcat=meshcat)
    simulator = Simulator(paths)
    lap = plan(lap=1, lap_time=2.0, start_time=1.0)
    fix(paths, simulator.get_mutable_context(), truth__state=np.zeros(13), lap_plan=lap)
    simulator.AdvanceTo(1.0 + 30 * 2.0 + 0.25)
    # One piece before gate 1, and one a lap.
    opacities = [property_of(meshcat, f"flown/{piece}", "opacity") for piece in range(31)]
    assert 0.02 < opacities[0] and np.all(np.diff(opacities) > 0.0) and opacities[-1] < 1.0
    paths.ForcedPublish(simulator.get_context())
    # Of the lap that is flown, nothing is faint.
    assert all(meshcat.HasPath(f"flown/{piece}") for piece in range(32))
    assert property_of(meshcat, "flown/31", "opacity") is None
