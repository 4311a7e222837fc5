"""The state filter: no lag, less noise, the optimal gain, and what pushes the drone."""

import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RotationMatrix
from pydrake.systems.analysis import Simulator

from airrace.systems.estimation import state_filter
from airrace.systems.estimation.state_filter import StateFilter, UnfilteredState, kalman_gain
from airrace.vehicle import GRAVITY, load_vehicle
from airrace.vehicle.air import Air, air_vector, drag_acceleration
from airrace.vehicle.state import STATE_SIZE, as_state

STATE_RATE, RATE = 200.0, 500.0
VEHICLES = {name: load_vehicle(name)[0] for name in ("Default", "StarOne")}
DEFAULT = VEHICLES["Default"]
PUSH = np.array([1.0, -2.0, 0.5])  # m/s^2, that nothing explains
NOTHING = np.zeros(3)
few = settings(max_examples=30)
both_drones = pytest.mark.parametrize("vehicle", VEHICLES.values(), ids=VEHICLES)


class Motion:
    """Constant thrust along an axis at rest, about which the drone spins, and a push."""

    def __init__(self, push=NOTHING, thrust=12.0, tilt=0.4, spin=2.0, turned=0.0):
        """Args: thrust: per mass (m/s^2). turned: all of it about the vertical (rad)."""
        self.T = RotationMatrix.MakeZRotation(turned)
        self.R = self.T @ RotationMatrix.MakeXRotation(tilt)
        self.spin, self.thrust = spin, thrust
        self.acceleration = self.R.col(2) * thrust + self.T @ push - [0, 0, GRAVITY]

    def at(self, time):
        """Returns the estimate, (14,)."""
        q = (self.R @ RotationMatrix.MakeZRotation(self.spin * time)).ToQuaternion().wxyz()
        v = self.T @ np.array([5.0, 0.0, -1.0])
        p = self.T @ np.array([1.0, 2.0, 3.0]) + time * v + time**2 / 2 * self.acceleration
        w = self.spin * self.R.col(2)
        return np.concatenate([[time], q, p, w, v + time * self.acceleration])

    def speeds(self, vehicle):
        c_f = vehicle.thrust_coefficients
        return np.full(len(c_f), np.sqrt(self.thrust * vehicle.mass / c_f.sum()))


class Bench:
    """A StateFilter fed with held estimates, as in the race."""

    def __init__(self, motion=None, vehicle=DEFAULT, state_rate=STATE_RATE, rate=RATE):
        self.motion = motion or Motion()
        self.filter = StateFilter(vehicle=vehicle, state_rate=state_rate, rate=rate)
        self.simulator = Simulator(self.filter)
        self.context = self.simulator.get_mutable_context()
        self.fix(self.motion.at(0.0), self.motion.speeds(vehicle))
        self.simulator.Initialize()

    def fix(self, estimate=None, speeds=None):
        for name, value in (("state_estimate", estimate), ("rotor_speeds", speeds)):
            if value is not None:
                self.filter.GetInputPort(name).FixValue(self.context, value)

    def at(self, time):
        self.simulator.AdvanceTo(time)
        return self.filter.GetOutputPort("filtered_estimate").Eval(self.context)

    @property
    def disturbance(self):
        return self.filter.GetOutputPort("disturbance").Eval(self.context).copy()

    def run(self, seconds, period=1 / STATE_RATE, noise=lambda: 0.0, look=0.9):
        """Feeds it; returns looks between two estimates, less the truth then."""
        errors = []
        for k in range(1, round(seconds / period)):
            self.at(k * period)
            self.fix(self.motion.at(k * period) + noise())
            time = (k + look) * period
            errors.append(self.at(time) - self.motion.at(time))
        return np.array(errors)


def noise_like_the_races(seed, position=0.005, velocity=0.3):
    rng = np.random.default_rng(seed)

    def noise():
        result = np.zeros(STATE_SIZE)
        as_state(result).position[:] = position * rng.normal(size=3)
        as_state(result).velocity[:] = velocity * rng.normal(size=3)
        return result

    return noise


@both_drones
@pytest.mark.parametrize(
    "period, look", [(1 / 200, 0.9), (1 / 200, 0.5), (1 / 100, 0.99), (0.03, 0.7)]
)
def test_what_the_rotors_explain_is_tracked_without_lag(vehicle, period, look):
    bench = Bench(vehicle=vehicle)
    errors = bench.run(1.0, period, look=look)
    np.testing.assert_allclose(as_state(errors.T).position, 0.0, atol=1e-9)
    np.testing.assert_allclose(as_state(errors.T).velocity, 0.0, atol=1e-9)
    np.testing.assert_allclose(bench.disturbance, 0.0, atol=1e-9)


def test_it_starts_at_the_first_estimate():
    bench = Bench()
    # Before its first tick, that is all there is.
    before = bench.filter.GetOutputPort("filtered_estimate").Eval(bench.context)
    np.testing.assert_array_equal(before, bench.motion.at(0.0))
    np.testing.assert_array_equal(bench.disturbance, 0.0)
    after = bench.at(0.001) - bench.motion.at(0.001)
    np.testing.assert_allclose(as_state(after).position, 0.0, atol=1e-12)
    np.testing.assert_allclose(as_state(after).velocity, 0.0, atol=1e-12)


@both_drones
def test_a_steady_push_is_found(vehicle):
    """And then it costs nothing any more."""
    bench = Bench(Motion(PUSH), vehicle)
    errors = bench.run(4.0)
    np.testing.assert_allclose(bench.disturbance, PUSH, atol=1e-6)
    np.testing.assert_allclose(as_state(errors[-1]).position, 0.0, atol=1e-6)
    np.testing.assert_allclose(as_state(errors[-1]).velocity, 0.0, atol=1e-6)
    # Most of it within half a second.
    bench = Bench(Motion(PUSH), vehicle)
    bench.run(0.5)
    assert np.linalg.norm(bench.disturbance - PUSH) < 0.2 * np.linalg.norm(PUSH)


def test_rotors_that_are_known_to_be_weaker_push_less():
    bench = Bench(Motion(PUSH))
    bench.filter.GetInputPort("rotor_factors").FixValue(bench.context, np.full(4, 0.95))
    bench.run(4.0)
    missing = 0.05 * bench.motion.thrust * bench.motion.R.col(2)
    np.testing.assert_allclose(bench.disturbance, PUSH + missing, atol=1e-6)


def test_drag_that_is_known_is_told_at_once():
    air = Air(0.1, 0.01, np.array([2.0, 0.0, 0.0]), 0.05, 0.01)
    bench = Bench(Motion(PUSH))
    bench.run(4.0)
    before = bench.disturbance
    bench.filter.GetInputPort("air").FixValue(bench.context, air_vector(air))
    now = as_state(bench.at(bench.context.get_time() + 1 / RATE))
    change = bench.disturbance - before
    z_B = bench.motion.R.col(2)
    np.testing.assert_allclose(change, drag_acceleration(now.velocity, z_B, air), atol=0.1)
    assert np.linalg.norm(change) > 1.0


def test_an_estimate_counts_once():
    """However often it is seen: the filter ticks faster than estimates come."""
    noise = np.zeros(STATE_SIZE)
    as_state(noise).position[:], as_state(noise).velocity[:] = 1.0, -1.0
    # With no spin, so that the thrust points where the estimate says.
    slow, fast = (Bench(Motion(spin=0.0), rate=rate) for rate in (200.0, 2000.0))
    for bench in (slow, fast):
        bench.at(0.005)
        bench.fix(bench.motion.at(0.005) + noise)
    # Between two estimates, only the prediction goes on.
    once = fast.at(0.00575).copy()
    found = fast.disturbance
    moved = fast.at(0.00985) - once
    acceleration = fast.motion.acceleration + found
    expected = as_state(once).velocity * 0.0041 + acceleration * 0.0041**2 / 2
    np.testing.assert_allclose(as_state(moved).velocity, 0.0041 * acceleration, atol=1e-12)
    np.testing.assert_allclose(as_state(moved).position, expected, atol=1e-12)
    np.testing.assert_array_equal(fast.disturbance, found)
    np.testing.assert_allclose(
        as_state(slow.at(0.00985)).position, as_state(fast.at(0.00985)).position, atol=1e-12
    )


def test_an_error_is_corrected_by_the_gain():
    bench = Bench(Motion(spin=0.0))
    bench.at(0.005)
    error = np.array([0.02, -0.5])
    noise = np.zeros(STATE_SIZE)
    as_state(noise).position[:], as_state(noise).velocity[:] = error
    bench.fix(bench.motion.at(0.005) + noise)
    now = bench.at(0.0081) - bench.motion.at(0.0081)
    expected = transition(0.0031) @ kalman_gain(1 / STATE_RATE) @ error
    np.testing.assert_allclose(as_state(now).position, expected[0], atol=1e-9)
    np.testing.assert_allclose(as_state(now).velocity, expected[1], atol=1e-9)
    np.testing.assert_allclose(bench.disturbance, expected[2], atol=1e-9)


def test_it_turns_with_the_world():
    noise = noise_like_the_races(3)
    one, other = (Bench(Motion(PUSH, turned=angle)) for angle in (0.0, 2.0))
    T = other.motion.T
    for k in range(1, 60):
        sample = noise()
        turned = sample.copy()
        as_state(turned).position[:], as_state(turned).velocity[:] = (
            T @ as_state(sample).position,
            T @ as_state(sample).velocity,
        )
        for bench, each in ((one, sample), (other, turned)):
            bench.at(k / STATE_RATE)
            bench.fix(bench.motion.at(k / STATE_RATE) + each)
    ours, turned = as_state(one.at(0.3)), as_state(other.at(0.3))
    np.testing.assert_allclose(turned.position, T @ ours.position, atol=1e-9)
    np.testing.assert_allclose(turned.velocity, T @ ours.velocity, atol=1e-9)
    np.testing.assert_allclose(other.disturbance, T @ one.disturbance, atol=1e-9)


def angle_between(q, R):
    return (RotationMatrix(Quaternion(q)).inverse() @ R).ToAngleAxis().angle()


numbers = st.floats(-1.0, 1.0)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)
rotations = (
    st.tuples(*[numbers] * 4)
    .map(np.array)
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: RotationMatrix(Quaternion(q / np.linalg.norm(q))))
)


def test_the_output_is_of_the_present():
    bench = Bench(Motion(spin=3.0))
    errors = bench.run(0.5)
    np.testing.assert_allclose(as_state(errors.T).quaternion, 0.0, atol=1e-6)
    estimate = np.array(bench.filter.GetInputPort("state_estimate").Eval(bench.context))
    output = bench.filter.GetOutputPort("filtered_estimate").Eval(bench.context)
    np.testing.assert_array_equal(
        as_state(output).angular_velocity, as_state(estimate).angular_velocity
    )
    assert as_state(output).time == bench.context.get_time() > as_state(estimate).time


def steady_covariance(dt, look):
    """Returns the error's covariance a time look after an estimate, (3, 3).

    Without process noise, e' = (I - K C) A e - K v, by Lyapunov's equation.
    """
    K, A, C = kalman_gain(dt), transition(dt), np.eye(3)[:2]
    F, R = (np.eye(3) - K @ C) @ A, np.diag([0.005**2, 0.3**2])
    P = np.zeros((3, 3))
    for _ in range(2000):
        P = F @ P @ F.T + K @ R @ K.T
    return transition(look) @ P @ transition(look).T


@pytest.mark.slow
def test_noise_is_reduced_as_much_as_theory_says():
    bench = Bench()
    found = []
    rng = noise_like_the_races(1)

    def noise():
        found.append(bench.disturbance)
        return rng()

    errors = bench.run(30.0, noise=noise)[200:]
    expected = np.sqrt(np.diag(steady_covariance(1 / STATE_RATE, 0.9 / STATE_RATE)))
    assert as_state(errors.T).position.std() == pytest.approx(expected[0], rel=0.1)
    assert as_state(errors.T).velocity.std() == pytest.approx(expected[1], rel=0.1)
    assert np.std(found[200:]) == pytest.approx(expected[2], rel=0.15)
    # Which is less than half of the noise on the position, and an eighth of that on the velocity.
    assert as_state(errors.T).position.std() < 0.005 / 2
    assert as_state(errors.T).velocity.std() < 0.3 / 8
    np.testing.assert_allclose(as_state(errors.mean(axis=0)).position, 0.0, atol=1e-3)
    np.testing.assert_allclose(as_state(errors.mean(axis=0)).velocity, 0.0, atol=1e-2)


@pytest.mark.parametrize("thrust, found", [(0.0, False), (0.49, False), (0.51, True)])
def test_the_ground_is_no_push(thrust, found):
    """Without half of the weight in thrust, whatever carries the drone is not learnt."""
    at_rest = Motion(
        push=np.array([0.0, 0.0, (1 - thrust) * GRAVITY]),
        thrust=thrust * GRAVITY,
        tilt=0.0,
        spin=0.0,
    )
    bench = Bench(at_rest)
    bench.run(0.5)
    assert np.any(bench.disturbance != 0.0) == found


def test_what_was_found_is_kept_when_the_thrust_is_gone():
    bench = Bench(Motion(PUSH))
    bench.run(2.0)
    before = bench.disturbance
    bench.fix(speeds=np.zeros(4))
    for k in range(400, 450):
        bench.at(k / STATE_RATE)
        bench.fix(bench.motion.at(k / STATE_RATE))
    np.testing.assert_allclose(bench.disturbance, before, rtol=1e-12)


def test_what_is_found_is_limited():
    push = np.array([30.0, -20.0, 10.0])
    bench = Bench(Motion(push))
    bench.run(2.0)
    found = bench.disturbance
    assert np.linalg.norm(found) == pytest.approx(8.0)
    np.testing.assert_allclose(found / 8.0, push / np.linalg.norm(push), atol=0.05)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("part", [0, 1, 5, 8, 11])
def test_a_broken_estimate_is_left_out(part, bad):
    """The next good one finds the filter where it should be."""
    bench = Bench()
    bench.run(0.1)
    broken = bench.motion.at(0.1)
    broken[part] = bad
    bench.at(0.1)
    bench.fix(broken)
    assert not np.all(np.isfinite(bench.at(0.11)))  # the controller is to know
    bench.fix(bench.motion.at(0.11))
    error = bench.at(0.115) - bench.motion.at(0.115)
    np.testing.assert_allclose(error[1:], 0.0, atol=1e-6)


def test_a_rotor_that_reports_no_speed_counts_as_standing():
    speeds = Motion().speeds(DEFAULT)
    outputs = []
    for value in (np.nan, np.inf, 0.0):
        speeds[2] = value
        bench = Bench()
        bench.fix(speeds=speeds)
        bench.at(0.05)
        bench.fix(bench.motion.at(0.05))
        outputs.append(np.append(bench.at(0.0599), bench.disturbance))
    np.testing.assert_array_equal(outputs[0], outputs[2])
    np.testing.assert_array_equal(outputs[1], outputs[2])


def transition(dt):
    """Returns the motion of position, velocity and disturbance, (3, 3)."""
    return np.array([[1.0, dt, dt**2 / 2], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])


@functools.cache
def covariances(dt):
    # The integral of what white noise on velocity and disturbance has become after dt.
    noise = np.diag([0.0, state_filter._ACCELERATION_NOISE, state_filter._DISTURBANCE_NOISE])
    nodes, weights = np.polynomial.legendre.leggauss(6)
    Q = sum(
        dt / 2 * weight * (transition(t) @ noise) @ (transition(t) @ noise).T
        for t, weight in zip(dt / 2 * (1 + nodes), weights)
    )
    R = np.diag([state_filter._POSITION_SIGMA**2, state_filter._VELOCITY_SIGMA**2])
    return transition(dt), Q, R


@few
@given(st.floats(1e-3, 1.0))
def test_the_gain_is_stable_and_shrinks_errors(dt):
    A, _, _ = covariances(dt)
    K, C = kalman_gain(dt), np.eye(3)[:2]
    assert np.abs(np.linalg.eigvals((np.eye(3) - K @ C) @ A)).max() < 1.0
    # It corrects towards the measurement and not past it.
    assert np.all(np.linalg.eigvals(K[:2]).real > 0)
    assert np.all(np.linalg.eigvals(K[:2]).real < 1)


@pytest.mark.parametrize("dt", [0.001, 1 / 200, 1 / 30, 0.1, 0.2])
def test_the_gain_is_the_limit_of_the_recursion(dt):
    A, Q, R = covariances(dt)
    C, P = np.eye(3)[:2], np.eye(3)
    for _ in range(int(200 + 10 / dt)):
        P = A @ P @ A.T + Q
        K = P @ C.T @ np.linalg.inv(C @ P @ C.T + R)
        P = (np.eye(3) - K @ C) @ P
    np.testing.assert_allclose(kalman_gain(dt), K, rtol=1e-5, atol=1e-9)


@given(vectors, vectors, st.floats(0.0, 100.0))
def test_unfiltered_is_the_newest_estimate_as_it_is(p, v, now):
    """As noisy and as old; and nothing pushes the drone."""
    system = UnfilteredState()
    context = system.CreateDefaultContext()
    context.SetTime(now)
    estimate = Motion().at(0.3)
    as_state(estimate).position[:], as_state(estimate).velocity[:] = p, v
    system.GetInputPort("state_estimate").FixValue(context, estimate)
    found = system.GetOutputPort("filtered_estimate").Eval(context)
    np.testing.assert_array_equal(found, estimate)
    np.testing.assert_array_equal(system.GetOutputPort("disturbance").Eval(context), 0.0)


def test_sizes_and_feedthrough():
    ours = StateFilter(vehicle=DEFAULT, state_rate=STATE_RATE, rate=RATE)
    assert ours.GetOutputPort("filtered_estimate").size() == STATE_SIZE
    assert ours.GetOutputPort("disturbance").size() == 3
    names = ("state_estimate", "rotor_speeds")
    estimate, speeds = (ours.GetInputPort(name).get_index() for name in names)
    filtered, disturbance = (
        ours.GetOutputPort(n).get_index() for n in ("filtered_estimate", "disturbance")
    )
    assert ours.HasDirectFeedthrough(estimate, filtered)  # attitude must not wait for a tick
    assert not ours.HasDirectFeedthrough(estimate, disturbance)
    assert not ours.HasDirectFeedthrough(speeds, disturbance)
