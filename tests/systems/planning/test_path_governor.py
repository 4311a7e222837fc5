"""The governor: it does nothing to a drone that follows, and waits for one that does not."""

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator

from airrace.scenario import Scenario
from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.systems.planning.path_clock import REGULAR, as_clock
from airrace.systems.planning.path_governor import _RATES, PathGovernor, _governed, _possible_rate
from airrace.vehicle import GRAVITY_W, load_vehicle
from airrace.vehicle.air import STILL_VECTOR, Air, air_vector
from tests.systems.planning.test_trajectory_tracker import PLAN

RATE = 500.0
VEHICLE, _ = load_vehicle("Default")
WEAKER = 0.25  # of the rotors' thrust: PLAN takes more


class Bench:
    """A governor, and a drone that is so far (m) above where its reference then is."""

    def __init__(self, plan=PLAN):
        self.plan, self.governor = plan, PathGovernor(vehicle=VEHICLE, rate=RATE)
        self.simulator = Simulator(self.governor)
        self.context = self.simulator.get_mutable_context()
        self.governor.GetInputPort("lap_plan").FixValue(self.context, Value[object](plan))
        self.references = []

    def fix(self, **inputs):
        for name, value in inputs.items():
            self.governor.GetInputPort(name).FixValue(self.context, value)

    @property
    def clock(self):
        return as_clock(self.governor.GetOutputPort("path_clock").Eval(self.context).copy())

    def fly(self, seconds, error):
        """Returns the clock after a time with an error."""
        port = self.governor.GetInputPort("filtered_estimate")
        for _ in range(round(seconds * RATE)):
            now = self.context.get_time()
            reference = self.clock.reference(PLAN, now)
            self.references.append(reference)
            estimate = np.zeros(14)
            estimate[5:8] = reference[:3] + [0.0, 0.0, error]
            port.FixValue(self.context, estimate)
            self.simulator.AdvanceTo(now + 1.0 / RATE)
        return self.clock


def test_who_follows_flies_the_plan_as_it_is():
    clock = Bench().fly(6.0, 0.149)
    assert not any(clock)


@pytest.mark.parametrize(("error", "slowing"), [(0.675, 0.35), (1.2, 0.7), (50.0, 0.7)])
def test_the_farther_the_slower(error, slowing):
    bench = Bench()
    bench.fly(4.0, 0.0)
    assert bench.fly(3.0, error).slowing == pytest.approx(slowing, abs=1e-3)


def test_then_it_goes_on_with_the_delay_that_there_is():
    bench = Bench()
    bench.fly(4.0, 1.0)
    clock = bench.fly(6.0, 0.0)
    assert clock.is_regular and clock.delay > 1.0
    assert bench.fly(0.1, 0.0) == clock


def test_its_reference_does_not_jump():
    """Acceleration and jerk stay within what a step of the snap makes of them."""
    bench = Bench()
    bench.fly(4.0, 0.0)
    bench.fly(1.0, 2.0)
    bench.fly(2.0, 0.0)
    steps = np.abs(np.diff(bench.references, axis=0)).max(axis=0)
    snap = np.abs(np.array(bench.references)[:, 12:15]).max()
    assert steps[9:12].max() < 1.5 * snap / RATE
    assert steps[:3].max() < 0.05 and steps[6:9].max() < 2.0


def test_without_a_plan_or_an_estimate_it_waits_for_nothing():
    assert not any(Bench(NO_PLAN).fly(1.0, 5.0))
    bench = Bench()
    bench.governor.GetInputPort("filtered_estimate").FixValue(bench.context, np.full(14, np.nan))
    bench.simulator.AdvanceTo(1.0)
    assert not any(bench.clock)


def test_a_scenario_may_have_it_never_wait():
    assert PathGovernor.from_scenario(Scenario())._waits
    bench = Bench()
    bench.governor._waits = PathGovernor(vehicle=VEHICLE, rate=RATE, waits=False)._waits
    bench.fix(rotor_factors=np.full(4, WEAKER))
    assert not any(bench.fly(5.0, 50.0))


def test_rotors_that_are_known_to_be_too_weak_are_waited_for_before_the_drone_is_late():
    bench = Bench()
    bench.fix(rotor_factors=np.full(4, 1.5), air=STILL_VECTOR)
    assert not any(bench.fly(4.0, 0.0))
    bench.fix(rotor_factors=np.full(4, WEAKER))
    assert bench.fly(2.0, 0.0).slowing > 0.1
    bench.fix(rotor_factors=np.ones(4))
    assert bench.fly(6.0, 0.0).is_regular


def test_so_is_air_that_takes_more_than_the_plan_counts_with():
    bench = Bench()
    bench.fix(air=air_vector(Air(3.0, 0.0, np.zeros(3))))
    assert bench.fly(6.0, 0.0).slowing > 0.1


@pytest.mark.parametrize("drag", [0.0, 0.2, 1.0])
def test_no_force_ahead_is_greater_than_the_rotors_give(drag):
    air, most = Air(drag, 0.0, np.zeros(3)), 25.0
    ahead = np.random.default_rng(3).normal(0.0, 10.0, (7, 2, 3))

    def greatest(rate):
        forces = rate**2 * ahead[:, 1] - GRAVITY_W + drag * rate * ahead[:, 0]
        return np.linalg.norm(forces, axis=1).max()

    rate = _possible_rate(ahead, air_vector(air), most, _RATES)
    assert rate in _RATES[1:-1] and greatest(rate) <= most < greatest(rate + 0.05)
    assert _possible_rate(ahead, air_vector(air), 1e3, _RATES) == 1.0
    assert _possible_rate(ahead, air_vector(air), 1.0, _RATES) == _RATES[-1]


def test_it_slows_gently_for_an_error_and_quickly_for_what_comes():
    """Both want the same in the end; a drone without thrust to spare is not braked at once."""
    late, ahead = (
        _governed(REGULAR, 0.0, *wanted).after(0.3).slowing for wanted in ((1.2, 0.0), (0.0, 0.7))
    )
    assert 0.0 < late < 0.2 * ahead
