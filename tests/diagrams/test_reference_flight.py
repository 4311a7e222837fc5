"""Flights without a race: the drone is steered by what it may know, and well."""

import textwrap

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from airrace.diagrams.reference_flight import CONTROL, MakeFlight, circle_reference, fly_reference
from airrace.scenario import ControllerConfig, Scenario, StateFilterConfig
from airrace.vehicle import RACERS
from airrace.vehicle.disturbances import DisturbancesConfig, RotorFailure, WindConfig
from tests.worlds.cases import first
from tests.worlds.flight import (
    PERIOD,
    deviations,
    fly,
    hover_reference,
    lap_reference,
    racing_lap,
    start_on,
)

LANDED = 0.15  # m, of height
both_drones = pytest.mark.parametrize("drone", RACERS)


def scenario(drone="Default", **fields):
    return Scenario(drone=drone, **{"laps": 1, "state_noise": "none", **fields})


def fly_on(flown, reference, seconds, **options):
    """Flies along a reference, and starts on it."""
    return fly(flown, reference, seconds, **options, **start_on(reference))


def lap(drone="Default"):
    """The reference track's, from a straight part of it."""
    return lap_reference(racing_lap(drone), 0.0)


def rms(flown, reference):
    return np.sqrt(np.mean(deviations(flown, reference) ** 2))


def sources(flight, box):
    """Yields the input ports of a box, and the names of producer and output port."""
    for (consumer, i), (producer, o) in flight.connection_map().items():
        if consumer.get_name() == box:
            yield (
                consumer.get_input_port(i).get_name(),
                producer.get_name(),
                producer.get_output_port(o).get_name(),
            )


@pytest.mark.slow
def test_what_controls_never_sees_the_truth():
    """Of the simulated world it sees the state estimate, and what the motors report."""
    flight = MakeFlight(scenario(), hover_reference(5.0))
    for box in CONTROL:
        fed = list(sources(flight, box))
        system = flight.GetSubsystemByName(box)
        names = {system.get_input_port(i).get_name() for i in range(system.num_input_ports())}
        learnt = {"rotor_factors", "air", "disturbance_moment"}  # of whom nobody tells it here
        assert names - {port for port, _, _ in fed} <= learnt
        for port, producer, output in fed:
            assert port == output
            assert producer in ("reference_source", *CONTROL) or (
                producer == "simulation"
                and port in ("state_estimate", "rotor_speeds", "rotor_status")
            )
    simulation = flight.GetSubsystemByName("simulation")
    estimate = simulation.GetOutputPort("state_estimate").get_index()
    system, _ = simulation.get_output_port_locator(estimate)
    assert type(system).__name__ == "StateEstimate"


def test_a_box_cannot_ask_for_the_truth(tmp_path, monkeypatch):
    (tmp_path / "curious_box.py").write_text(
        textwrap.dedent("""
        from airrace.systems.estimation.state_filter import StateFilter
        from airrace.vehicle import load_vehicle

        class Curious(StateFilter):
            def __init__(self, scenario):
                vehicle, _ = load_vehicle(scenario.drone)
                super().__init__(vehicle=vehicle, state_rate=200.0, rate=500.0)
                self.DeclareVectorInputPort("truth.state", 13)
    """)
    )
    monkeypatch.syspath_prepend(tmp_path)
    flight = MakeFlight(
        scenario(systems={"state_filter": "curious_box:Curious"}), hover_reference(5.0)
    )
    assert "truth.state" not in [port for port, _, _ in sources(flight, "state_filter")]


@both_drones
def test_a_hover_stays(drone):
    flown = fly_on(scenario(drone), hover_reference(8.0), 1.0)
    assert deviations(flown, hover_reference(8.0)).max() < 0.002
    assert np.hypot(flown.speeds[-1], np.linalg.norm(flown.angular_velocities[-1])) < 0.01
    assert np.all(np.isinf(flown.losses))


def test_the_same_flight_twice():
    noisy = scenario(
        state_noise="nominal", seed=3, disturbances=DisturbancesConfig(thrust_coefficient_error=0.1)
    )
    one, other, quiet = (
        fly_on(each, hover_reference(8.0), 0.3) for each in (noisy, noisy, scenario())
    )
    for name in ("rotations", "positions", "angular_velocities", "velocities"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert np.any(quiet.positions != one.positions)


@pytest.mark.slow
@both_drones
@pytest.mark.parametrize("noise", first(["reference", "none"]))
def test_it_recovers_from_upside_down(drone, noise):
    R_WB = RollPitchYaw(np.pi, 0.0, 1.0).ToRotationMatrix()
    X_WB = RigidTransform(R_WB, [0.0, 0.0, 20.0])
    flown = fly(scenario(drone, state_noise=noise), hover_reference(20.0), 2.5, X_WB=X_WB)
    assert flown.positions[:, 2].min() > 18.5  # m
    assert flown.tilts[flown.times > 2.1].max() < 2.0
    assert deviations(flown, hover_reference(20.0))[-1] < 0.05
    assert flown.speeds[-1] < 0.2
    assert np.all(np.isinf(flown.losses))


@both_drones
def test_it_follows_a_lap(drone):
    flown = fly_on(scenario(drone), lap(), 4.0)
    assert rms(flown, lap()) < 0.02
    assert flown.speeds.max() > 10.0  # m/s


def test_the_feed_forward_is_why():
    without = scenario(controller=ControllerConfig(feed_forward=False))
    assert rms(fly_on(without, lap(), 3.0), lap()) > 0.04


# The original system's: slower and simpler, on the noisy estimate itself.
ORIGINAL = dict(
    state_noise="nominal",
    state_filter=StateFilterConfig(enabled=False),
    controller=ControllerConfig(
        rate=800.0,
        feed_forward=False,
        disturbance_rejection=False,
        attitude_error="lee",
        gains="original",
        rotor_overdrive=False,
    ),
)


@pytest.mark.parametrize("drone", first(RACERS))
def test_the_originals_controller_hovers(drone):
    """At its 800 Hz, which the plant's step of 1 ms does not divide."""
    flown = fly_on(scenario(drone, **ORIGINAL), hover_reference(8.0), 3.0)
    assert deviations(flown, hover_reference(8.0)).max() < 0.06  # m
    assert flown.tilts.max() < 1.0


@both_drones
def test_the_originals_controller_follows_a_lap_from_a_distance(drone):
    flown = fly_on(scenario(drone, **ORIGINAL), lap(), 4.0)
    assert 0.3 < rms(flown, lap()) < 3.0


AIR = {
    "wind": DisturbancesConfig(drag=1.0, wind=WindConfig(mean=[5.0, -3.0, 0.0])),
    "mass": DisturbancesConfig(mass_error=0.2),
}


@pytest.mark.parametrize("drone", first(RACERS))
@pytest.mark.parametrize("disturbances", AIR.values(), ids=AIR)
def test_what_pushes_it_does_not_move_it(drone, disturbances):
    """Not for long; without disturbance rejection it stays away."""
    end = {}
    for rejection in (True, False):
        config = ControllerConfig(disturbance_rejection=rejection)
        pushed = scenario(drone, disturbances=disturbances, controller=config)
        flown = fly_on(pushed, hover_reference(8.0), 3.0)
        end[rejection] = deviations(flown, hover_reference(8.0))[-1]
    assert end[True] < 0.01
    assert end[False] > 10 * end[True]


def assert_landed_softly(flown):
    assert flown.positions[-1, 2] < LANDED
    assert flown.speeds[-1] < 1.0  # m/s


@pytest.mark.slow
@pytest.mark.parametrize("rotor", first([1, 2, 3, 4]))
def test_a_quadrotor_without_a_rotor_comes_down_softly(rotor):
    failing = scenario(rotor_failures=[RotorFailure(rotor, 0.3)])
    flown = fly_on(failing, hover_reference(2.0), 12.0, down_to=LANDED)
    assert_landed_softly(flown)
    assert flown.tilts[-1] < 20.0
    assert 0.3 < flown.losses[rotor - 1] <= 0.32
    assert np.count_nonzero(np.isfinite(flown.losses)) == 1
    # On the way it never tips over, nor does it drift far.
    assert flown.tilts.max() < 90.0
    assert np.linalg.norm(flown.positions[:, :2], axis=1).max() < 5.0


@pytest.mark.repeats
def test_the_spin_settles_on_a_long_way_down():
    """Without drag nothing stops it but the rotor opposite the lost one."""
    failing = scenario(rotor_failures=[RotorFailure(3, 0.3)])
    flown = fly_on(failing, hover_reference(14.0), 40.0, down_to=LANDED)
    assert_landed_softly(flown)
    spins = np.abs(flown.angular_velocities[:, 2])  # about the vertical
    assert spins[-1] > 30.0 and spins.max() < 45.0


@pytest.mark.slow
def test_it_comes_down_from_a_lap_as_well():
    """When the rotor stops, it is fast and leans into a bend."""
    failing = scenario(rotor_failures=[RotorFailure(2, 3.0)], state_noise="nominal")
    flown = fly_on(failing, lap(), 15.0, down_to=LANDED)
    assert flown.speeds[round(3.0 / PERIOD)] > 15.0
    assert_landed_softly(flown)


@pytest.mark.parametrize("rotor", first([1, 4, 6, 7]))
def test_the_star_one_stays_without_a_rotor(rotor):
    failing = scenario("StarOne", rotor_failures=[RotorFailure(rotor, 0.3)])
    flown = fly_on(failing, hover_reference(8.0), 1.5)
    assert deviations(flown, hover_reference(8.0)).max() < 0.05
    assert 0.3 < flown.losses[rotor - 1] <= 0.32
    assert np.count_nonzero(np.isfinite(flown.losses)) == 1


def test_the_star_one_flies_on_along_a_lap():
    failing = scenario("StarOne", rotor_failures=[RotorFailure(3, 1.0)])
    flown = fly_on(failing, lap(), 3.0)
    assert deviations(flown, lap()).max() < 0.05


def test_a_circle_is_flown_and_told():
    start = dict(X_WB=RigidTransform([9.0, 0.0, 6.0]))
    flown = fly_reference(Scenario(), circle_reference(8.0, 4.0, 6.0, [1.0, 0.0]), 4.0, **start)
    assert flown.ended is None and len(flown.times) == len(flown.errors) == 400
    assert flown.errors[-50:].max() < 0.05
    assert flown.speeds[-50:] == pytest.approx(4.0, abs=0.1)
    assert flown.turn_rates[-50:] == pytest.approx(4.0 / 8.0, abs=0.1)
    assert flown.tilts[-50:] == pytest.approx(np.rad2deg(np.arctan2(2.0, 9.81)), abs=1.5)
