"""A race in pydrake's own Simulator is right: it goes on, starts again, and gates have bodies."""

import numpy as np
import pytest
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.analysis import Simulator

from airrace.common.resources import models_path
from airrace.diagrams.simulation import MakeMonitor
from airrace.scenario import Scenario, load_scenario
from airrace.scenario.camera_config import CameraConfig
from tests.drake_user.flights import HEXAGON, OwnRace, on_a_map
from tests.worlds.cases import first

SMALL = CameraConfig(width=64, height=48, preset="realistic")
MOVING = "{disturbances: {gate_shift: 1.0}}"
PLACES = ("state_estimate", "imu", "camera_image_time", "rotor_status", "truth.state")


def seen(race, context):
    """All that sensors show, and a picture."""
    values = [race.value(p, context) for p in PLACES if race.simulation.HasOutputPort(p)]
    grey = race.value("camera_grey", context).data if "camera_grey" in names(race) else 0
    return [np.array(v) for v in (*values, grey)]


def names(race):
    """Of the outputs of the simulation."""
    count = race.simulation.num_output_ports()
    return [race.simulation.get_output_port(i).get_name() for i in range(count)]


@pytest.mark.parametrize("time", first([0.4137, 0.4, 0.5005]))
@pytest.mark.parametrize(
    "fields", ["{}", "{estimator: vio}", "{camera: {effects: {latency: 0.02}}}"]
)
def test_a_copied_context_goes_on(time, fields):
    """With Initialize(), to the last bit: nothing is sampled twice, and nothing too early."""
    scenario = load_scenario(scenario_text=fields)
    scenario.track, scenario.camera.width, scenario.camera.height = HEXAGON, 64, 48
    race = OwnRace(scenario)
    race.simulator.AdvanceTo(time)
    copy = Simulator(race.diagram, race.simulator.get_context().Clone())
    again = race.simulator
    for each in (copy, again):
        each.Initialize()
        each.AdvanceTo(time + 0.3)
    plain = OwnRace(scenario)
    plain.simulator.AdvanceTo(time + 0.3)
    expected = seen(plain, plain.simulator.get_context())
    for each in (copy, again):
        for a, b in zip(seen(race, each.get_context()), expected):
            np.testing.assert_array_equal(a, b)


def test_a_flight_may_start_late():
    """Sensors show where the drone is at that time."""
    race = OwnRace(Scenario(track=HEXAGON, camera=SMALL))
    race.simulator.get_mutable_context().SetTime(5.0)
    race.simulator.Initialize()
    assert race.value("camera_image_time") == [5.0] and race.value("state_estimate")[0] == 5.0


def test_a_late_start_shows_no_picture_from_before():
    """With latency, until the first picture that is taken on time appears."""
    scenario = load_scenario(scenario_text="{camera: {effects: {latency: 0.02}}}")
    scenario.track, scenario.camera.width, scenario.camera.height = HEXAGON, 64, 48
    race = OwnRace(scenario)
    race.simulator.get_mutable_context().SetTime(1.01)
    race.simulator.Initialize()
    for time in (1.021, 1.03, 1.06):
        race.simulator.AdvanceTo(time)
        assert race.value("camera_image_time")[0] >= 1.01


def test_a_drone_may_be_put_elsewhere():
    """It flies back to where it waits."""
    race = OwnRace(on_a_map())
    race.simulator.AdvanceTo(2.0)
    plant, context = race.subsystem("plant")
    before = race.value("truth.state")
    positions = plant.GetPositions(context).copy()
    positions[4:7] += [0.3, 0.3, 0.2]
    plant.SetPositions(context, positions)
    race.simulator.AdvanceTo(2.01)
    assert np.linalg.norm(race.value("truth.state")[4:7] - before[4:7]) > 0.3
    race.simulator.AdvanceTo(3.5)
    assert not race.value("truth.referee_status").over


def gate_places(race):
    """Where the bodies of the gates are, (n, 2) m."""
    plant, context = race.subsystem("plant")
    n = race.value("truth.gate_shifts").size // 2
    bodies = [plant.GetBodyByName(f"gate_{i + 1}") for i in range(n)]
    return [plant.EvalBodyPoseInWorld(context, body).translation()[:2] for body in bodies]


def test_gates_take_their_bodies_along():
    race = OwnRace(on_a_map(MOVING))
    race.simulator.set_monitor(MakeMonitor(race.diagram))
    race.simulator.AdvanceTo(12.5)
    shifts = race.value("truth.gate_shifts").reshape(-1, 2)
    assert np.count_nonzero(shifts.any(axis=1)) >= 1
    np.testing.assert_array_equal(gate_places(race), shifts)


def test_without_the_monitor_it_says_what_to_do():
    race = OwnRace(on_a_map(MOVING))
    with pytest.raises(RuntimeError, match=r"their bodies have not: call simulator.set_monitor\("):
        race.simulator.AdvanceTo(12.5)
    (moved,) = np.unique(np.nonzero(race.value("truth.gate_shifts"))[0] // 2)
    assert (np.array(gate_places(race))[moved] == 0.0).all()


def test_two_races_take_turns():
    """Simulators of one diagram know nothing of each other."""
    race = OwnRace(on_a_map())
    first, second = Simulator(race.diagram), Simulator(race.diagram)
    for time in (0.2, 0.5, 1.0):
        first.AdvanceTo(time)
        second.AdvanceTo(time)
    states = [race.value("truth.state", each.get_context()) for each in (first, second)]
    np.testing.assert_array_equal(*states)


def test_a_mass_may_be_set_in_a_context():
    """The plant's own parameters are the context's."""
    race = OwnRace(on_a_map())
    plant, context = race.subsystem("plant")
    body = plant.GetBodyByName("body")
    assert isinstance(body.index(), BodyIndex)
    body.SetMass(context, 1.05 * body.get_mass(context))
    race.simulator.AdvanceTo(3.0)
    assert not race.value("truth.referee_status").over


def test_the_models_are_a_package_of_drake():
    assert (models_path() / "package.xml").is_file()
