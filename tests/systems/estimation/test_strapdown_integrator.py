"""StrapdownIntegrator alone, through its Context."""

import numpy as np
import pytest

from airrace.systems.estimation.navigation import NAVIGATION_SIZE
from airrace.systems.estimation.strapdown_integrator import StrapdownIntegrator, history_depth
from airrace.systems.sensing.imu_samples import IMU_SIZE
from airrace.vehicle import GRAVITY, load_vehicle
from airrace.vehicle.state import STATE_SIZE, as_state
from tests.systems.estimation.motions import PERIOD, navigation

VEHICLE = load_vehicle("Default")[0]
HOVER = np.sqrt(VEHICLE.mass * GRAVITY / VEHICLE.thrust_coefficients.sum()) * np.ones(4)


class Flight:
    """An integrator that is fed samples."""

    def __init__(self, **options):
        start = np.zeros(STATE_SIZE)
        start[1] = 1.0
        self.system = StrapdownIntegrator(
            vehicle=VEHICLE,
            rate=1 / PERIOD,
            depth=80,
            start=start,
            ranges=np.full(6, 50.0),
            **options,
        )
        self.context = self.system.CreateDefaultContext()
        self.samples = np.full((10, 7), -1.0)
        self.fix("corrections", np.full(NAVIGATION_SIZE, -1.0))
        self.fix("rotor_speeds", HOVER)
        self.fix("imu", self.samples.ravel())
        self.time = 0.0

    def fix(self, port, value):
        self.system.GetInputPort(port).FixValue(self.context, value)

    def read(self, port):
        return self.system.GetOutputPort(port).Eval(self.context)

    def feel(self, w=(0.0, 0.0, 0.0), f=(0.0, 0.0, GRAVITY), steps=1):
        """Shows samples, and updates."""
        for _ in range(steps):
            self.time += PERIOD
            noise = 1e-11 * self.time  # only a sensor that is stuck shows the same twice
            sample = np.array([0.0, *w, *f]) + noise
            sample[0] = self.time
            self.samples = np.vstack([sample, self.samples[:-1]])
            self.fix("imu", self.samples.ravel())
            self.update()

    def update(self):
        self.context.SetTime(self.time)
        discrete = self.system.EvalUniquePeriodicDiscreteUpdate(self.context)
        self.context.SetDiscreteState(discrete)

    def correct(self, **state):
        self.fix("corrections", navigation(time=self.time, **state))
        self.update()


@pytest.fixture
def flight():
    flight = Flight()
    flight.feel()
    flight.correct()
    return flight


def test_it_integrates_from_the_last_correction(flight):
    flight.feel(f=(1.0, 0.0, GRAVITY), steps=100)
    state = as_state(flight.read("state_estimate"))
    assert state.time == pytest.approx(flight.time)
    np.testing.assert_allclose(state.velocity, [0.2, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(state.position, [0.02, 0.0, 5.0], atol=1e-9)


def test_a_late_correction_is_carried_to_the_present(flight):
    flight.feel(f=(1.0, 0.0, GRAVITY), steps=50)
    flight.fix("corrections", navigation(p=(1.0, 2.0, 3.0), v=(4.0, 0.0, 0.0), time=0.052))
    flight.update()
    T = flight.time - 0.052
    state = as_state(flight.read("state_estimate"))
    np.testing.assert_allclose(state.velocity, [4.0 + T, 0, 0], atol=1e-9)
    np.testing.assert_allclose(state.position, [1 + 4 * T + T**2 / 2, 2, 3], atol=1e-9)


def test_the_filtered_estimate_is_of_the_present(flight):
    """With a sample that the state does not have yet, and beyond it."""
    flight.feel(f=(1.0, 0.0, GRAVITY), steps=10)
    newest = flight.read("state_estimate")[0]
    flight.context.SetTime(newest + 0.003)
    assert flight.read("filtered_estimate")[0] == pytest.approx(newest + 0.003)
    velocity = as_state(flight.read("filtered_estimate")).velocity[0]
    assert velocity == pytest.approx(10 * PERIOD + 0.003)


def test_before_anything_is_known_it_stands_at_its_start():
    flight = Flight()
    flight.feel(f=(3.0, 0.0, 0.0), steps=20)
    for port in ("state_estimate", "filtered_estimate"):
        np.testing.assert_array_equal(flight.read(port)[1:], [1.0, *np.zeros(12)])


def test_the_disturbance_is_what_the_rotors_do_not_explain(flight):
    flight.feel(f=(2.0, 0.0, GRAVITY), steps=500)
    np.testing.assert_allclose(flight.read("disturbance"), [2.0, 0.0, 0.0], atol=0.01)
    before = flight.read("disturbance")
    flight.correct(p=(3.0, 0.0, 5.0))  # a jump of the pose
    np.testing.assert_array_equal(flight.read("disturbance"), before)


def test_on_the_ground_there_is_no_disturbance(flight):
    flight.fix("rotor_speeds", 0.3 * HOVER)
    flight.feel(f=(2.0, 0.0, GRAVITY), steps=100)
    np.testing.assert_array_equal(flight.read("disturbance"), np.zeros(3))


@pytest.mark.parametrize("value", [np.nan, np.inf, 50.0])
def test_what_is_not_finite_is_bridged(flight, value):
    flight.feel(f=(1.0, 0.0, GRAVITY), steps=5)
    flight.feel(f=(value, 0.0, GRAVITY), steps=5)
    assert np.isfinite(flight.read("filtered_estimate")).all()
    flight.feel(f=(1.0, 0.0, GRAVITY), steps=5)
    state = as_state(flight.read("state_estimate"))
    np.testing.assert_allclose(state.velocity, [15 * PERIOD, 0, 0], atol=1e-9)
    assert np.isfinite(flight.read("disturbance")).all()


def test_lost_samples_are_bridged(flight):
    flight.feel(f=(1.0, 0.0, GRAVITY), steps=5)
    flight.time += 0.02
    flight.update()
    flight.context.SetTime(flight.time)
    velocity = as_state(flight.read("filtered_estimate")).velocity[0]
    assert velocity == pytest.approx(0.03, abs=1e-6)
    flight.feel(f=(1.0, 0.0, GRAVITY))
    assert as_state(flight.read("state_estimate")).velocity[0] == pytest.approx(0.032, abs=1e-6)


def test_a_correction_that_is_not_finite_is_none(flight):
    flight.feel(steps=3)
    broken = navigation(time=flight.time)
    broken[5] = np.nan
    flight.fix("corrections", broken)
    flight.feel()
    assert np.isfinite(flight.read("state_estimate")).all()


def test_the_history_reaches_back_a_picture_and_more(flight):
    depth = history_depth(30.0, 0.02, 500.0)
    assert depth * PERIOD > 0.02 + 1 / 30
    flight.feel(steps=100)
    history = flight.read("imu_history").reshape(-1, 7)
    np.testing.assert_allclose(history[:, 0], flight.time - PERIOD * np.arange(80), atol=1e-9)
    assert flight.samples.size == IMU_SIZE


def test_a_silent_sensor_is_replaced_by_what_the_rotors_do(flight):
    """With one rotor faster than the others, the drone turns as Euler's equations say."""
    flight.feel(steps=5)
    assert flight.read("imu_silence")[0] == pytest.approx(0.0)
    speeds = HOVER * [1.01, 1.0, 1.0, 1.0]
    flight.fix("rotor_speeds", speeds)
    for _ in range(100):
        flight.time += PERIOD
        flight.update()
    assert flight.read("imu_silence")[0] == pytest.approx(0.2)
    wrench = VEHICLE.allocation @ (VEHICLE.thrust_coefficients * speeds**2)
    turning = wrench[1:] / VEHICLE.inertia
    w = as_state(flight.read("state_estimate")).angular_velocity
    np.testing.assert_allclose(w, turning * (0.2 - 0.009), rtol=0.05)  # the mean of ten samples


def test_on_the_ground_rotors_do_not_replace_the_sensor(flight):
    flight.fix("rotor_speeds", 0.3 * HOVER)
    before = flight.read("state_estimate").copy()
    for _ in range(100):
        flight.time += PERIOD
        flight.update()
    np.testing.assert_array_equal(flight.read("state_estimate"), before)


def test_a_stuck_sensor_is_silent(flight):
    flight.feel(f=(1.0, 0.0, GRAVITY), steps=5)
    for _ in range(100):
        flight.time += PERIOD
        flight.samples = np.vstack([flight.samples[0], flight.samples[:-1]])
        flight.samples[0, 0] = flight.time
        flight.fix("imu", flight.samples.ravel())
        flight.update()
    assert flight.read("imu_silence")[0] > 0.15


@pytest.mark.parametrize("link_delay, replaced", [(0.0, True), (0.2, False)])
def test_samples_that_a_link_delays_are_no_silence(link_delay, replaced):
    """They come 60 ms late, and all count."""
    flight = Flight(link_delay=link_delay)
    flight.correct()
    flight.feel()
    flight.correct()
    for _ in range(40):
        sample_time, flight.time = flight.time, flight.time + 0.06
        flight.update()  # on the autonomy's clock, which is ahead
        flight.time = sample_time
        flight.feel()
    history = flight.read("imu_history").reshape(-1, 7)
    assert (history[0, 0] > flight.time) == replaced
