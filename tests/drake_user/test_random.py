"""Random contexts give different races, and a seed the same one."""

import functools

import numpy as np
import pytest
from pydrake.common import RandomGenerator
from pydrake.systems.analysis import MonteCarloSimulation, Simulator
from pydrake.systems.framework import DiagramBuilder

from airrace.diagrams.reference_flight import MakeFlight
from airrace.diagrams.simulation import MakeMonitor, MakeSimulation
from airrace.scenario import Scenario, load_scenario
from airrace.scenario.camera_config import CameraConfig
from airrace.trajopt.flat_trajectory import hold
from tests.drake_user.flights import HEXAGON, OwnRace, on_a_map

WILD = (
    "{disturbances: {drag: 1.0, wind: {mean_speed: 3.0, gust_rms: 1.0}, mass_error: 0.05, "
    "inertia_error: 0.05, thrust_coefficient_error: 0.03}}"
)


def states(race, context):
    """Truth, estimate and wind."""
    wind, own = race.subsystem("wind", context)
    return [race.value("truth.state", context), race.value("state_estimate", context),
            wind.get_output_port().Eval(own)]  # fmt: skip


def simulator_of(race, context):
    """A Simulator with the monitor, which goes on from a context."""
    simulator = Simulator(race.diagram, context)
    simulator.set_monitor(MakeMonitor(race.diagram))
    return simulator


def flown(race, seed, seconds=0.3):
    """What a race shows after some time, from a random context; of None, from the default one."""
    context = race.diagram.CreateDefaultContext()
    if seed is not None:
        race.diagram.SetRandomContext(context, RandomGenerator(seed))
    simulator = simulator_of(race, context)
    simulator.AdvanceTo(seconds)
    return [each.copy() for each in states(race, simulator.get_context())]


def test_random_contexts_differ_and_a_seed_repeats():
    race = OwnRace(on_a_map(WILD))
    default = flown(race, None)
    for a, b in zip(flown(race, None), default):
        np.testing.assert_array_equal(a, b)
    first, second, again = flown(race, 1), flown(race, 2), flown(race, 1)
    for a, b, c, d in zip(first, second, default, again):
        assert (a != b).any() and (a != c).any()
        np.testing.assert_array_equal(a, d)


def test_the_default_context_is_the_scenarios():
    """Also after a random one; and a seed that is written is that of such a scenario."""
    race, other = OwnRace(on_a_map(WILD)), OwnRace(on_a_map(WILD, seed=7))
    context = race.diagram.CreateDefaultContext()
    race.diagram.SetRandomContext(context, RandomGenerator(5))
    race.diagram.SetDefaultContext(context)
    for seed, expected in ((None, flown(race, None)), (7, flown(other, None))):
        if seed is not None:
            source, own = race.subsystem("seed_source", context)
            own.get_mutable_numeric_parameter(0).SetAtIndex(0, seed)
        simulator = simulator_of(race, context.Clone())
        simulator.AdvanceTo(0.3)
        for a, b in zip(states(race, simulator.get_context()), expected):
            np.testing.assert_array_equal(a, b)


def test_a_drawn_mass_needs_the_monitor():
    race = OwnRace(on_a_map(WILD))
    context = race.diagram.CreateDefaultContext()
    race.diagram.SetRandomContext(context, RandomGenerator(1))
    plant, own = race.subsystem("plant", context)
    before = plant.GetBodyByName("body").get_mass(own)
    simulator = Simulator(race.diagram, context.Clone())
    with pytest.raises(RuntimeError, match=r"of another seed .* call simulator.set_monitor\("):
        simulator.AdvanceTo(0.05)
    simulator = simulator_of(race, context)
    simulator.AdvanceTo(0.01)
    plant, own = race.subsystem("plant", simulator.get_mutable_context())
    assert plant.GetBodyByName("body").get_mass(own) != before


def test_pictures_have_the_noise_of_the_contexts_seed():
    """A seed that is written gives the picture of such a scenario."""
    config = CameraConfig(width=64, height=48, preset="harsh")
    pictures = []
    for seed, written in ((0, 7), (7, 7), (0, 0)):
        race = OwnRace(Scenario(track=HEXAGON, camera=config, seed=seed))
        _, own = race.subsystem("seed_source")
        own.get_mutable_numeric_parameter(0).SetAtIndex(0, written)
        race.simulator.Initialize()
        pictures.append(race.value("camera_grey").data.copy())
    np.testing.assert_array_equal(pictures[0], pictures[1])
    assert (pictures[0] != pictures[2]).any()


@pytest.mark.parametrize("seed", [-1.0, 1.5, np.nan])
def test_a_seed_is_a_whole_number(seed):
    race = OwnRace(on_a_map(WILD))
    _, own = race.subsystem("seed_source")
    own.get_mutable_numeric_parameter(0).SetAtIndex(0, seed)
    with pytest.raises(ValueError, match="seed of a simulation must be a whole number"):
        race.simulator.AdvanceTo(0.01)


def test_a_late_start_has_the_contexts_wind():
    race = OwnRace(on_a_map(WILD))
    winds = []
    for seed in (None, 1, 2):
        context = race.diagram.CreateDefaultContext()
        context.SetTime(5.0)
        if seed is not None:
            race.diagram.SetRandomContext(context, RandomGenerator(seed))
        simulator = simulator_of(race, context)
        simulator.Initialize()
        winds.append(states(race, simulator.get_context())[2].copy())
    assert np.unique(winds, axis=0).shape == (3, 3) and np.isfinite(winds).all()


def test_one_monitor_serves_several_races():
    builder = DiagramBuilder()
    for name in ("one", "two"):
        simulation = MakeSimulation(on_a_map(WILD))
        builder.AddNamedSystem(name, simulation)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.SetRandomContext(context, RandomGenerator(1))
    MakeMonitor(diagram)(context)
    masses = [
        plant.GetBodyByName("body").get_mass(plant.GetMyContextFromRoot(context))
        for plant in (
            diagram.GetSubsystemByName(n).GetSubsystemByName("plant") for n in ("one", "two")
        )
    ]
    assert masses[0] != masses[1]


def monte_carlo(make_simulator, output, seconds, samples, seed):
    """The outputs of a MonteCarloSimulation."""
    results = MonteCarloSimulation(make_simulator, output, seconds, samples, RandomGenerator(seed))
    return [result.output for result in results]


def hovering(scenario, generator):
    """A Simulator of a drone that hovers."""
    simulator = Simulator(MakeFlight(scenario, lambda time: hold([0.0, 0.0, 2.0], 0.0)))
    simulator.set_monitor(MakeMonitor(simulator.get_system()))
    return simulator


def height(system, context):
    """Of the drone (m)."""
    return float(system.GetOutputPort("truth.state").Eval(context)[6])


def test_monte_carlo():
    """Twenty samples, twenty results; twice the same by the same generator."""
    scenario = load_scenario(scenario_text=WILD)
    run = functools.partial(monte_carlo, functools.partial(hovering, scenario), height, 0.2)
    heights = run(20, 3)
    assert len(set(heights)) == 20
    assert heights[:5] == run(5, 3) != run(5, 4)


@pytest.mark.repeats
def test_monte_carlo_of_whole_races():
    """Of twenty laps no two are alike."""

    def make(generator):
        race = OwnRace(on_a_map(WILD))
        race.simulator.set_monitor(MakeMonitor(race.diagram))
        return race.simulator

    def last_gate(system, context):
        simulation = system.GetSubsystemByName("simulation")
        own = simulation.GetMyContextFromRoot(context)
        status = simulation.GetOutputPort("truth.referee_status").Eval(own)
        return status.crossings[-1].time

    times = monte_carlo(make, last_gate, 15.0, 20, 0)
    assert len(set(times)) == 20
    assert times[:3] == monte_carlo(make, last_gate, 15.0, 3, 0)
