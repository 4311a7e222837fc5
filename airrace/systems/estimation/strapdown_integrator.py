"""Carries pose and velocity forward with every sample of the inertial sensor."""

import math
from typing import NamedTuple

import numpy as np

from airrace.common.jit import all_finite, assign, compilable, compiled
from airrace.common.packing import Packing
from airrace.math.small_matrices import apply
from airrace.math.triples import added, cross, difference, dot, rotate, rotation_rows, scaled
from airrace.systems.estimation.navigation import (
    NAVIGATION_SIZE,
    as_navigation,
    carried_to,
    remember,
    write_state,
)
from airrace.systems.estimation.state_filter import FLYING, MAX_DISTURBANCE, specific_thrust
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_or, read_vector
from airrace.systems.sensing.imu_samples import (
    IMU_SIZE,
    SAMPLE_SIZE,
    ImuSample,
    as_sample,
    sample_vector,
)
from airrace.vehicle import GRAVITY, Vehicle
from airrace.vehicle.free_body import angular_acceleration
from airrace.vehicle.state import STATE_SIZE

_TIME_CONSTANT = 0.15  # s, of the disturbance
_SILENT = 0.03  # s without a sample; over a link, they come five at a time
_FORGET = 0.99  # of the age of samples, at each
_SPARE = 0.1  # s, of samples, should pictures come late
_UNLIMITED = np.full(6, np.inf)
_AVERAGED = 10  # samples, of the angular velocity in `state_estimate`


def history_depth(fps: float, latency: float, imu_rate: float) -> int:
    """Returns how many samples have to be kept until the next picture is worked on.

    Args:
        fps: of the camera (Hz).
        latency: from an exposure to its detections (s).
        imu_rate: of the inertial sensor (Hz).
    """
    return math.ceil((latency + 2.0 / fps + _SPARE) * imu_rate)


class StrapdownIntegrator(LeafSystem):
    """Integrates inertial samples, from where GateSlam last knew the drone to be.

    .. pydrake_system::

        name: StrapdownIntegrator
        input_ports:
        - imu
        - corrections
        - rotor_speeds
        - rotor_factors (may be left open: rotors are as in the drone's file)
        output_ports:
        - state_estimate
        - filtered_estimate
        - disturbance
        - imu_history
        - imu_silence

    ``imu`` (70) see ImuSamples; ``corrections`` (17) is a Navigation of a moment ago;
    ``rotor_speeds`` as measured (rad/s), ``rotor_factors`` see RotorLearner.
    ``state_estimate`` (14) is of the newest sample's time, its angular velocity the mean of ten;
    ``filtered_estimate`` (14) is of the present, with all that the sensor has shown.
    ``disturbance`` (3) is the acceleration that rotors and gravity do not explain (m/s^2, in the
    world), smoothed: the accelerometer less the rotors' thrust. So neither noise of the estimate
    nor a correction of it drives it. ``imu_history`` (7 n) are the
    newest n samples, newest first, for GateSlam; ``imu_silence`` (1) is the time since the newest
    sample of the sensor that was sound (s).

    After a correction, the samples since then are integrated anew. What the sensor shows is
    dropped if it is not finite, at the end of the range or stuck; a sample that is missing is
    bridged by the next. If the sensor is silent in flight, what the rotors should do to the drone
    takes the place of its samples, until it shows something again: enough for a landing.
    """

    def __init__(
        self,
        *,
        vehicle: Vehicle,
        rate: float,
        depth: int,
        start: np.ndarray,
        ranges: np.ndarray = _UNLIMITED,
        link_delay: float = 0.0,
    ):
        """Constructs the integrator.

        Args:
            vehicle: mass, rotors and where the sensor is.
            rate: of the sensor (Hz).
            depth: n of ``imu_history``, see history_depth().
            start: the state before anything is known, see vehicle/state.py, (14,).
            ranges: of the sensor's angular velocity (rad/s) and specific force (m/s^2), (6,).
            link_delay: by which samples may come late, so that nothing has failed (s).
        """
        LeafSystem.__init__(self)
        model = _Model(
            np.array(vehicle.imu.position, float),
            np.array(ranges, float),
            1.0 / rate,
            _SILENT + link_delay,
            vehicle.thrust_coefficients / vehicle.mass,
            vehicle.allocation * vehicle.thrust_coefficients,
            np.array([vehicle.mass, *vehicle.inertia]),
        )
        self._model = tuple(model)
        self._imu = self.DeclareVectorInputPort("imu", IMU_SIZE)
        self._corrections = self.DeclareVectorInputPort("corrections", NAVIGATION_SIZE)
        self._ones = np.ones(len(vehicle.rotors))
        self._speeds = self.DeclareVectorInputPort("rotor_speeds", len(vehicle.rotors))
        self._factors = self.DeclareVectorInputPort("rotor_factors", len(vehicle.rotors))
        # One vector: to get several from the Context takes longer than a step. But the disturbance
        # is read as often as it changes, and of a state of its own that calls no Python.
        self._memory = self.DeclareDiscreteState(_initial_memory(depth, start))
        self._disturbance = self.DeclareDiscreteState(3)
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / rate, 0.0, self._update)
        self._declare_part("state_estimate", STATE_SIZE, lambda memory: memory.estimate)
        self.DeclareVectorOutputPort("filtered_estimate", STATE_SIZE, self._calc_filtered)
        self.DeclareStateOutputPort("disturbance", self._disturbance)
        self._declare_part("imu_history", depth * SAMPLE_SIZE, lambda memory: memory.history)
        self.DeclareVectorOutputPort("imu_silence", 1, self._calc_silence)

    def _declare_part(self, name, size, part):
        """Declares an output port of a part of the memory, (size,)."""

        def calc(context, output):
            output.set_value(part(self._read(context)).ravel())

        self.DeclareVectorOutputPort(name, size, calc, {self.discrete_state_ticket(self._memory)})

    def _read(self, context):
        return _as_memory(context.get_discrete_state(self._memory).value())

    def _update(self, context, discrete_state):
        _step(
            discrete_state.get_mutable_value(self._memory),
            discrete_state.get_mutable_value(self._disturbance),
            read_vector(self._imu, context),
            read_vector(self._corrections, context),
            read_vector(self._speeds, context),
            read_or(self._ones, self._factors, context),
            context.get_time(),
            self._model,
        )

    def _calc_filtered(self, context, output):
        _carry_forward(
            output.get_mutable_value(),
            context.get_discrete_state(self._memory).value(),
            read_vector(self._imu, context),
            read_vector(self._speeds, context),
            context.get_time(),
            self._model,
        )

    def _calc_silence(self, context, output):
        output.set_value([context.get_time() - self._read(context).heard[0]])


class _Model(NamedTuple):
    """The integrator's constants."""

    p_BI: np.ndarray  #: where the sensor is mounted (m), (3,)
    ranges: np.ndarray  #: of its angular velocity (rad/s) and specific force (m/s^2), (6,)
    period: float  #: of its samples (s)
    silent: float  #: time without a sample that is too long (s)
    thrust_per_mass: np.ndarray  #: see specific_thrust(), (r,)
    #: Matrix from the rotors' squared speeds to [T, Mx, My, Mz], (4, r).
    wrench_by_squares: np.ndarray
    inertia: np.ndarray  #: mass (kg) and moments of inertia (kg m^2), (4,)


class _Memory(NamedTuple):
    """What the integrator remembers, as views of a vector."""

    history: np.ndarray  #: samples, newest first, (n, 7)
    navigation: np.ndarray  #: vector of a Navigation, (17,)
    corrected: np.ndarray  #: the time of the correction that it goes on from (s), (1,)
    estimate: np.ndarray  #: at the newest sample, (14,)
    heard: np.ndarray  #: time of the sensor's newest sound sample (s), (1,)
    expected: np.ndarray  #: the angular velocity since (rad/s), (3,)
    age: np.ndarray  #: how old the newest sample has been of late when it came (s), (1,)


_PACKING = Packing(
    _Memory,
    history=(-1, SAMPLE_SIZE),
    navigation=NAVIGATION_SIZE,
    corrected=1,
    estimate=STATE_SIZE,
    heard=1,
    expected=3,
    age=1,
)
_as_memory = _PACKING.parts


def _initial_memory(depth, start):
    """Returns the vector of a _Memory before anything is known; see StrapdownIntegrator."""
    vector = np.zeros(depth * SAMPLE_SIZE + _PACKING.size)
    memory = _as_memory(vector)
    memory.history[:, 0] = memory.navigation[0] = memory.corrected[0] = -1.0
    memory.estimate[:] = start
    return vector


@compiled
def _step(vector, disturbance, samples, corrections, speeds, factors, now, model):
    """Takes up what the sensor has shown, and a correction; see StrapdownIntegrator.

    Args:
        vector: of the _Memory; is changed.
        disturbance: (m/s^2, in W), (3,); is changed.
        samples: of the sensor, newest first, (7 m,).
        corrections: vector of a Navigation, (17,).
        speeds: of the rotors (rad/s), (r,).
        factors: of their thrusts, (r,).
        now: (s).
        model: a _Model, as a tuple.
    """
    memory, constants = _as_memory(vector), _Model(*model)
    history, heard, last = memory.history, memory.heard, memory.history[0, 0]
    samples = samples.reshape((-1, SAMPLE_SIZE))
    thrust, count = specific_thrust(constants.thrust_per_mass * factors, speeds), 0
    if not _is_stuck(samples, thrust, last > heard[0]):
        count = remember(history, samples, constants.ranges)
    if count > 0:
        heard[0] = history[0, 0]
        memory.age[0] = max(now - heard[0], _FORGET * memory.age[0])
    count = _replace_silence(memory, count, now, speeds, constants)
    _advance(memory, count, corrections, constants.p_BI)
    _smooth(disturbance, last, memory, thrust, constants.p_BI)


@compiled
def _carry_forward(result, vector, samples, speeds, time, model):
    """Writes the estimate for a time (s), (14,), with the samples that are not in it yet.

    Args: see _step(); only the result changes.
    """
    memory, constants = _as_memory(vector), _Model(*model)
    samples = samples.reshape((-1, SAMPLE_SIZE))
    assign(result, memory.estimate)
    recent = memory.history[: len(samples)].copy()
    thrust = specific_thrust(constants.thrust_per_mass, speeds)
    bridges = memory.history[0, 0] > memory.heard[0]
    if not _is_stuck(samples, thrust, bridges):
        remember(recent, samples, constants.ranges)
    if memory.navigation[0] >= 0.0 and recent[0, 0] > 0.0:
        state = as_navigation(carried_to(memory.navigation, recent, time))
        w = difference(as_sample(recent[0]).angular_velocity, state.gyro_bias)
        write_state(result, state, w, constants.p_BI)


@compilable
def _is_stuck(samples, thrust, bridges):
    """Whether a sensor in flight shows the same again and again, to the last bit.

    With little thrust, by mass (m/s^2), the drone may stand; but not while it ``bridges``: then the
    newest sample was made up, because the sensor is silent.
    """
    if not bridges and thrust < FLYING * GRAVITY:
        return False
    for sample in samples[1:]:
        if sample[0] <= 0.0 or np.any(sample[1:] != samples[0, 1:]):
            return False
    return True


@compilable
def _replace_silence(memory, count, now, speeds, constants):
    """Writes a sample as the rotors let it be expected, once the sensor is silent.

    With total thrust T and moments M of the rotors, mass m and moments of inertia J, Euler's
    equations give the angular velocity, and the specific force at p_BI follows:

        J dw/dt = M - w x J w,   f = [0, 0, T / m] + dw/dt x p_BI + w x (w x p_BI).

    What is made up is as old as the sensor's samples are when they come, so that its next one is
    newer. ``count`` samples are new; for the rest see _step().

    Returns: how many samples are new; none are written before anything is known, and on the ground.
    """
    history, heard, expected = memory.history, memory.heard[0], memory.expected
    state = as_navigation(memory.navigation)
    if count > 0:
        newest = as_sample(history[0])
        assign(expected, difference(newest.angular_velocity, state.gyro_bias))
        return count
    wrench = apply(constants.wrench_by_squares * speeds, speeds)
    mass, J, p_BI = constants.inertia[0], constants.inertia[1:], constants.p_BI
    if not state.time >= 0.0 or not all_finite(wrench):
        return 0
    turning = angular_acceleration(wrench[1:], expected, J)
    assign(expected, added(expected, constants.period, turning))
    # Once it has begun it goes on, with however little thrust.
    flies = history[0, 0] > heard or wrench[0] > FLYING * GRAVITY * mass
    time = now - memory.age[0]
    if not flies or not now - heard > constants.silent or not time > history[0, 0]:
        return 0
    f = added(cross(turning, p_BI), 1.0, cross(expected, cross(expected, p_BI)))
    f = (f[0], f[1], f[2] + wrench[0] / mass)
    sample = sample_vector(
        ImuSample(time, expected + state.gyro_bias, np.array(f) + state.accel_bias)
    )
    return remember(history, sample.reshape((1, SAMPLE_SIZE)), _UNLIMITED)


@compilable
def _advance(memory, count, corrections, p_BI):
    """Takes up new samples, ``count`` of them, and a new correction; for the rest see _step()."""
    history, navigation = memory.history, memory.navigation
    newest = history[0, 0]
    if all_finite(corrections) and corrections[0] > memory.corrected[0]:
        time = max(newest, corrections[0])
        assign(navigation, carried_to(corrections, history, time))
        memory.corrected[0] = corrections[0]
    elif count > 0 and navigation[0] >= 0.0:
        assign(navigation, carried_to(navigation, history, newest))
    else:
        return
    state, recent, w = as_navigation(navigation), history[:_AVERAGED], np.zeros(3)
    for sample in recent:
        w += as_sample(sample).angular_velocity / len(recent)
    write_state(memory.estimate, state, difference(w, state.gyro_bias), p_BI)


@compilable
def _smooth(disturbance, last, memory, thrust, p_BI):
    """Smooths the disturbance, (3,), with the samples since the last step's newest one.

    Args: see _step(); the time of that sample (s), and the rotors' thrust by mass (m/s^2).
    """
    history, state = memory.history, as_navigation(memory.navigation)
    if not state.time >= 0.0 or last < 0.0 or thrust < FLYING * GRAVITY:
        return
    R_WB = rotation_rows(state.quaternion)
    for sample in history[::-1]:
        time, angular_velocity, specific_force = as_sample(sample)
        dt = time - last
        if dt <= 0.0:
            continue
        last = time
        w = difference(angular_velocity, state.gyro_bias)
        f = difference(difference(specific_force, state.accel_bias), cross(w, cross(w, p_BI)))
        unexplained = rotate(R_WB, (f[0], f[1], f[2] - thrust))
        share = 1.0 - math.exp(-dt / _TIME_CONSTANT)
        assign(disturbance, added(disturbance, share, difference(unexplained, disturbance)))
    length = math.sqrt(dot(disturbance, disturbance))
    assign(disturbance, scaled(min(1.0, MAX_DISTURBANCE / max(length, 1e-9)), disturbance))
