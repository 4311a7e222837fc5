import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from scipy.spatial.transform import Rotation

from airrace.systems.sensing.imu import Imu
from airrace.systems.sensing.imu_samples import IMU_DEPTH, IMU_SIZE, ImuSamples, as_samples
from airrace.vehicle import GRAVITY, GRAVITY_W
from airrace.vehicle.imu_errors import ImuErrors, axis_matrices, turn_on_biases
from airrace.vehicle.sensor_failures import ImuFailure

RATE, T = 500.0, 0.002
STILL = np.array([1.0, 0, 0, 0, 1, 2, 3, 0, 0, 0, 0, 0, 0])
UP = np.array([0, 0, GRAVITY])


class Motion(LeafSystem):
    """Shows the state (13) that a function of time gives."""

    def __init__(self, state):
        LeafSystem.__init__(self)
        self.DeclareVectorOutputPort(
            "state", 13, lambda context, output: output.set_value(state(context.get_time()))
        )


def measure(state=lambda time: STILL, seconds=0.1, **kwargs):
    """Returns the ImuSamples of a motion, oldest first, up to the number that there should be."""
    builder = DiagramBuilder()
    imu = builder.AddSystem(Imu(rate=RATE, **kwargs))
    motion = builder.AddSystem(Motion(state))
    builder.Connect(motion.get_output_port(), imu.GetInputPort("state"))
    simulator = Simulator(builder.Build())
    context = imu.GetMyContextFromRoot(simulator.get_context())
    simulator.Initialize()
    assert all(as_samples(imu.get_output_port().Eval(context)).time < 0.0)
    blocks = []
    for k in range(IMU_DEPTH, round(seconds * RATE) + 1, IMU_DEPTH):
        simulator.AdvanceTo(k * T + 0.1 * T)
        blocks.append(imu.get_output_port().Eval(context).reshape(IMU_DEPTH, -1)[::-1])
    rows = np.vstack(blocks)
    return as_samples(rows[rows[:, 0] > 0.0].ravel())


def pose(coefficients):
    """Returns a motion: p_WB(t), v_WB(t), R_WB(t) and w_WB(t), by (3, 4) random numbers."""
    a, b, turn, tilt = np.array(coefficients).reshape(4, 3)

    def position(t):
        return a * np.sin(7 * t + b)

    def velocity(t):
        return 7 * a * np.cos(7 * t + b)

    def rotation(t):  # an axis that moves
        return Rotation.from_rotvec(tilt * np.sin(5 * t)) * Rotation.from_rotvec(turn * t)

    def spin(t):
        return 5 * np.cos(5 * t) * tilt + Rotation.from_rotvec(tilt * np.sin(5 * t)).apply(turn)

    return position, velocity, rotation, spin


def as_motion(position, velocity, rotation, spin):
    def state(t):
        q = rotation(t).as_quat(scalar_first=True)
        return np.concatenate([q, position(t), spin(t), velocity(t)])

    return state


_motions = st.lists(st.floats(-3.0, 3.0), min_size=12, max_size=12).map(pose)


def integrate(samples, R, v, p):
    """Returns attitude, velocity and position after the samples, as ImuSamples says."""
    for w, f in zip(samples.angular_velocity, samples.specific_force):
        a = R.apply(f) + GRAVITY_W
        p = p + v * T + a * T**2 / 2
        v = v + a * T
        R = R * Rotation.from_rotvec(w * T)
    return R, v, p


@settings(deadline=None, max_examples=20)
@given(_motions)
def test_an_ideal_imu_integrates_back_to_the_motion(motion):
    position, velocity, rotation, _ = motion
    samples = measure(as_motion(*motion))
    np.testing.assert_allclose(samples.time, T * np.arange(1, 51), rtol=0, atol=1e-12)
    R, v, p = integrate(samples, rotation(0.0), velocity(0.0), position(0.0))
    assert (R.inv() * rotation(0.1)).magnitude() < 1e-9
    np.testing.assert_allclose(v, velocity(0.1), rtol=0, atol=1e-9)
    # Of a mean acceleration, the position has an error of jerk T^3 / 12 a step.
    np.testing.assert_allclose(p, position(0.1), rtol=0, atol=50 * 7**3 * 3 * T**3 / 12)


@settings(deadline=None, max_examples=20)
@given(_motions, st.lists(st.floats(-0.3, 0.3), min_size=3, max_size=3))
def test_with_a_lever_arm_it_is_the_sensor_that_moves(motion, arm):
    position, velocity, rotation, spin = motion

    def v_WI(t):
        return velocity(t) + np.cross(spin(t), rotation(t).apply(arm))

    samples = measure(as_motion(*motion), position=arm)
    R, v, p = integrate(samples, rotation(0.0), v_WI(0.0), np.zeros(3))
    np.testing.assert_allclose(v, v_WI(0.1), rtol=0, atol=1e-9)
    assert (R.inv() * rotation(0.1)).magnitude() < 1e-9


def test_a_lever_arm_feels_the_centripetal_force():
    def state(t):
        return [np.cos(5 * t), 0, 0, np.sin(5 * t), 0, 0, 0, 0, 0, 10.0, 0, 0, 0]

    samples = measure(state, position=[0.1, 0.0, 0.02])
    np.testing.assert_allclose(samples.angular_velocity, np.tile([0, 0, 10.0], (50, 1)), atol=1e-9)
    middle = samples.specific_force[10]
    assert middle == pytest.approx([-(10.0**2) * 0.1, 0.0, GRAVITY], abs=0.11)  # turns by 0.01
    assert np.hypot(*middle[:2]) == pytest.approx(10.0, rel=1e-3)


def test_at_rest_it_shows_what_holds_it_up_and_its_biases():
    samples = measure()
    assert np.all(samples.angular_velocity == 0.0)
    np.testing.assert_allclose(samples.specific_force, np.tile(UP, (50, 1)), rtol=1e-12)
    errors = ImuErrors(gyro_bias=0.01, accelerometer_bias=0.3)
    bias = turn_on_biases(errors, seed=3)
    samples = measure(errors=errors, seed=3)
    np.testing.assert_allclose(samples.angular_velocity, np.tile(bias[:3], (50, 1)))
    np.testing.assert_allclose(samples.specific_force, np.tile(UP + bias[3:], (50, 1)))


def test_free_fall_weighs_nothing():
    def state(t):
        return [*STILL[:4], 0, 0, 50 - GRAVITY * t**2 / 2, 0, 0, 0, 0, 0, -GRAVITY * t]

    np.testing.assert_allclose(measure(state).specific_force, 0.0, atol=1e-11)


def test_a_quaternion_that_is_not_of_length_1_and_its_negative_are_rotations():
    def state(t):
        q = [np.cos(t / 2), np.sin(t / 2), 0, 0]
        return np.concatenate([q, STILL[4:7], [1.0, 0, 0], np.zeros(3)])

    def odd(t):
        factors = np.ones(13)
        factors[:4] = (-1) ** round(t / T) * (1.0 + 0.2 * np.sin(100 * t))
        return factors * state(t)

    for ours, its in zip(measure(odd), measure(state)):
        np.testing.assert_allclose(ours, its, rtol=0, atol=1e-12)


def allan_deviation(values, m):
    """Returns the Allan deviation of samples (n, 3) at an averaging time of m samples."""
    means = values[: len(values) // m * m].reshape(-1, m, 3).mean(axis=1)
    return np.sqrt(np.mean(np.diff(means, axis=0) ** 2) / 2)


@pytest.mark.parametrize("m", [1, 25])
def test_the_noise_is_white_and_has_its_density(m):
    samples = measure(
        seconds=40.0, errors=ImuErrors(gyro_noise=0.001, accelerometer_noise=0.02), seed=1
    )
    tau = m * T
    gyro, accelerometer = samples.angular_velocity, samples.specific_force
    assert allan_deviation(gyro, m) == pytest.approx(0.001 / np.sqrt(tau), rel=0.05)
    assert allan_deviation(accelerometer, m) == pytest.approx(0.02 / np.sqrt(tau), rel=0.05)
    everything = np.hstack([gyro, accelerometer])
    correlations = np.corrcoef(everything.T) - np.eye(6)
    assert np.abs(correlations).max() < 0.04
    assert abs(np.mean(gyro)) < 4 * 0.001 / np.sqrt(3 * 40.0)


def test_biases_walk_as_the_square_root_of_time():
    walks = {"gyro_walk": 0.001, "accelerometer_walk": 0.02}
    ends = {1.0: [], 4.0: []}
    for seed in range(30):
        samples = measure(seconds=4.0, errors=ImuErrors(**walks), seed=seed)
        errors = np.hstack([samples.angular_velocity / 0.001, (samples.specific_force - UP) / 0.02])
        for time, values in ends.items():
            values.append(errors[round(time * RATE) - 1])
    for time, values in ends.items():  # 180 numbers: the deviation is known to 5 %
        assert np.std(values) == pytest.approx(np.sqrt(time), rel=0.17)


def test_it_starts_with_other_biases_for_every_seed():
    errors = ImuErrors(gyro_bias=0.01, accelerometer_bias=0.3)
    biases = np.array([turn_on_biases(errors, seed) for seed in range(300)])
    assert biases[:, :3].std() == pytest.approx(0.01, rel=0.1)
    assert biases[:, 3:].std() == pytest.approx(0.3, rel=0.1)


def test_scale_and_axes():
    errors = ImuErrors(scale=0.01, axes=0.002)
    E = np.array([axis_matrices(errors, seed) - np.eye(3) for seed in range(200)])
    is_scale = np.eye(3, dtype=bool)
    assert E[..., is_scale].std() == pytest.approx(0.01, rel=0.1)
    assert E[..., ~is_scale].std() == pytest.approx(0.002, rel=0.1)

    def state(t):
        q = Rotation.from_rotvec([t, -2 * t, 3 * t]).as_quat(scalar_first=True)
        return np.concatenate([q, STILL[4:7], [1, -2, 3], np.zeros(3)])

    true, shown = measure(state), measure(state, errors=errors, seed=5)
    gyro, accelerometer = axis_matrices(errors, 5)
    np.testing.assert_allclose(shown.angular_velocity, true.angular_velocity @ gyro.T)
    np.testing.assert_allclose(shown.specific_force, true.specific_force @ accelerometer.T)


def test_an_axis_shows_no_more_than_its_range():
    def state(t):
        return [np.cos(20 * t), 0, 0, -np.sin(20 * t), 0, 0, 0, 0, 0, -40.0, 80 * t, 0, 0]

    samples = measure(state, errors=ImuErrors(gyro_range=34.9, accelerometer_range=9.0))
    assert np.all(samples.angular_velocity == [0, 0, -34.9])
    assert np.all(samples.specific_force[:, 2] == 9.0)
    assert np.abs(samples.specific_force[:, :2]).max() == 9.0


@pytest.mark.parametrize("latency, late", [(0.0, 0), (0.002, 1), (0.0051, 3), (0.05, 25)])
def test_samples_appear_late(latency, late):
    def state(t):
        return [*STILL[:10], 3 * t, 0, 0]

    errors = ImuErrors(gyro_noise=0.001)
    prompt = measure(state, errors=errors, seconds=0.2)
    delayed = measure(state, errors=ImuErrors(gyro_noise=0.001, latency=latency), seconds=0.2)
    n = 100 - late
    assert len(delayed.time) == n
    for ours, its in zip(delayed, prompt):
        np.testing.assert_array_equal(ours, its[:n])


@pytest.mark.parametrize("offset", [0.005, -0.005])
def test_a_clock_that_is_ahead_or_behind_changes_only_the_times(offset):
    errors = ImuErrors(gyro_noise=0.001)
    right, wrong = measure(errors=errors), measure(errors=dc.replace(errors, time_offset=offset))
    n = len(wrong.time)  # what would be before the start is left out
    assert n == (50 if offset > 0.0 else 48)
    np.testing.assert_allclose(wrong.time, right.time[-n:] + offset, atol=1e-12)
    np.testing.assert_array_equal(wrong.angular_velocity, right.angular_velocity[-n:])


def test_the_same_seed_gives_the_same_samples_whatever_the_motion():
    errors = ImuErrors(gyro_noise=0.001, gyro_bias=0.01, gyro_walk=0.001, accelerometer_noise=0.1)

    def sample(seed, state=lambda time: STILL):
        return np.hstack(measure(state, errors=errors, seed=seed)[1:])

    assert sample(1).tobytes() == sample(1).tobytes()
    assert not np.any(sample(1) == sample(2))

    def moving(t):
        return [*STILL[:10], 4 * t, 0, 0]

    difference = sample(1, moving) - sample(1)
    np.testing.assert_allclose(difference, np.tile([0, 0, 0, 4, 0, 0], (50, 1)), atol=1e-12)


@pytest.mark.parametrize("period", [0.001, 0.002, 0.003])
def test_of_a_plant_in_steps(period):
    """Also if its steps do not end when samples do."""
    w, v, t = np.array([0.0, 0.0, 4.0]), np.array([20.0, -3.0, 1.0]), 0.0
    imu = Imu(rate=RATE, state_period=period)
    simulator = Simulator(imu)
    context = simulator.get_mutable_context()
    for k in range(1, 40):
        end = np.ceil(t / period - 1e-6) * period  # what a discrete plant shows
        state = np.concatenate([[np.cos(2 * end), 0, 0, np.sin(2 * end)], end * v, w, v])
        imu.GetInputPort("state").FixValue(context, state)
        if k == 1:
            simulator.Initialize()
        simulator.AdvanceTo(t + 0.1 * T)
        t = k * T
    samples = as_samples(imu.get_output_port().Eval(context))
    np.testing.assert_allclose(samples.angular_velocity, np.tile(w, (IMU_DEPTH, 1)), atol=1e-4)
    np.testing.assert_allclose(samples.specific_force, np.tile(UP, (IMU_DEPTH, 1)), atol=1e-9)


class TestFailures:
    """Samples 21 to 30, which end from 0.042 s to 0.06 s, are wrong."""

    ERRORS = ImuErrors(
        gyro_noise=0.001, gyro_walk=0.001, gyro_range=30.0, accelerometer_range=150.0
    )

    def measure(self, kind, start=0.042, duration=0.02, latency=0.0):
        errors = dc.replace(self.ERRORS, latency=latency)
        return measure(errors=errors, failures=[ImuFailure(kind, start, duration)])

    def rows(self, samples):
        return np.column_stack(samples)

    @pytest.mark.parametrize("latency", [0.0, 0.002, 0.01])
    def test_lost(self, latency):
        good = self.rows(measure(errors=self.ERRORS))
        lost = self.rows(self.measure("lost", latency=latency))
        expected = np.delete(good, range(20, 30), axis=0)
        unseen = round(latency / T)
        # measure() reads ten samples a tick: those that were not there are read twice.
        _, first = np.unique(lost[:, 0], return_index=True)
        np.testing.assert_array_equal(lost[first], expected[: len(expected) - unseen])

    def test_while_samples_are_lost_none_is_new(self):
        imu = Imu(rate=RATE, failures=[ImuFailure("lost", 0.05, 0.05)])
        simulator = Simulator(imu)
        context = simulator.get_mutable_context()
        imu.GetInputPort("state").FixValue(context, STILL)
        newest = []
        for k in range(1, 60):
            simulator.AdvanceTo((k + 0.5) * T)
            newest.append(as_samples(imu.get_output_port().Eval(context)).time[0])
        before, gap, after = np.split(np.array(newest), [24, 49])
        np.testing.assert_allclose(before, T * np.arange(1, 25))
        np.testing.assert_allclose(gap, 0.048)
        np.testing.assert_allclose(after, T * np.arange(50, 60))

    @pytest.mark.parametrize("latency", [0.0, 0.01])
    @pytest.mark.parametrize("kind", ["nan", "stuck", "saturated"])
    def test_wrong(self, kind, latency):
        good, bad = measure(errors=self.ERRORS), self.measure(kind, latency=latency)
        good, bad = self.rows(good), self.rows(bad)
        good = good[: len(bad)]
        np.testing.assert_array_equal(bad[:, 0], good[:, 0])
        is_wrong = np.arange(len(bad)) // 10 == 2
        np.testing.assert_array_equal(bad[~is_wrong], good[~is_wrong])
        shown = {
            "nan": np.full(6, np.nan),
            "stuck": good[19, 1:],
            "saturated": [30.0] * 3 + [150.0] * 3,
        }[kind]
        np.testing.assert_array_equal(bad[is_wrong, 1:], np.tile(shown, (10, 1)))

    def test_without_an_end(self):
        samples = self.measure("nan", start=0.05, duration=None)
        assert np.all(np.isnan(samples.specific_force[24:]))
        assert np.all(np.isfinite(samples.specific_force[:24]))


def test_samples_are_views():
    vector = np.arange(1.0 * IMU_SIZE)
    samples = as_samples(vector)
    assert samples.time.tolist() == list(range(0, 70, 7))
    assert isinstance(samples, ImuSamples) and all(np.shares_memory(x, vector) for x in samples)
    np.testing.assert_array_equal(samples.angular_velocity[1], [8, 9, 10])
    np.testing.assert_array_equal(samples.specific_force[9], [67, 68, 69])


def test_it_samples_when_other_systems_of_its_rate_are_updated():
    """To the last bit: otherwise some would see a sample sooner than others."""
    samples = measure(seconds=1.0)
    assert samples.time.tolist() == [k * (1.0 / RATE) for k in range(1, 501)]
