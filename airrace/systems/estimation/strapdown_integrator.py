"""Carries pose and velocity forward with every sample of the inertial sensor."""

import math
from typing import NamedTuple

import numpy as np

from airrace.common.jit import all_finite, assign, compilable, compiled
from airrace.math.quaternion import rotation_matrix
from airrace.math.vec3 import cross, dot, rotate
from airrace.systems.estimation.navigation import (
    NAVIGATION_SIZE,
    SAMPLE_SIZE,
    as_navigation,
    carried_to,
    remember,
    write_state,
)
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_vector
from airrace.systems.sensing.imu_samples import IMU_SIZE
from airrace.vehicle import GRAVITY, Vehicle
from airrace.vehicle.state import STATE_SIZE

_TIME_CONSTANT = 0.15  # s, of the disturbance
_MAX_DISTURBANCE = 8.0  # m/s^2
_SILENT = 0.03  # s without a sample; over a link, they come five at a time
_FORGET = 0.99  # of the age of samples, at each
_FLYING = 0.5  # of the weight: with less thrust, the ground may carry the drone
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
        output_ports:
        - state_estimate
        - filtered_estimate
        - disturbance
        - imu_history
        - imu_silence

    ``imu`` (70) see ImuSamples; ``corrections`` (17) is a Navigation of a moment ago;
    ``rotor_speeds`` as reported (rad/s). ``state_estimate`` (14) is of the newest sample's time,
    its angular velocity the mean of ten; ``filtered_estimate`` (14) is of the present, with all
    that the sensor has shown. ``disturbance`` (3) is the acceleration that rotors and gravity do
    not explain (m/s^2, in the world), smoothed: the accelerometer less the rotors' thrust. So
    neither noise of the estimate nor a correction of it drives it. ``imu_history`` (7 n) are the
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
            vehicle.allocation * vehicle.thrust_coefficients,
            np.array([vehicle.mass, *vehicle.inertia]),
        )
        self._model = tuple(model)
        self._imu = self.DeclareVectorInputPort("imu", IMU_SIZE)
        self._corrections = self.DeclareVectorInputPort("corrections", NAVIGATION_SIZE)
        self._speeds = self.DeclareVectorInputPort("rotor_speeds", len(vehicle.rotors))
        history = np.zeros((depth, SAMPLE_SIZE))
        history[:, 0] = -1.0
        # The Navigation, and the time of the correction that it goes on from.
        memory = np.zeros(NAVIGATION_SIZE + 1)
        memory[0] = memory[-1] = -1.0
        self._history = self.DeclareDiscreteState(history.ravel())
        self._memory = self.DeclareDiscreteState(memory)
        self._disturbance = self.DeclareDiscreteState(3)
        self._estimate = self.DeclareDiscreteState(start)
        # The time of the sensor's newest sound sample (s), the angular velocity since (rad/s), and
        # how old the newest sample has been of late when it came (s).
        self._heard = self.DeclareDiscreteState(5)
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / rate, 0.0, self._update)
        self.DeclareStateOutputPort("state_estimate", self._estimate)
        self.DeclareVectorOutputPort("filtered_estimate", STATE_SIZE, self._calc_filtered)
        self.DeclareStateOutputPort("disturbance", self._disturbance)
        self.DeclareStateOutputPort("imu_history", self._history)
        self.DeclareVectorOutputPort(
            "imu_silence",
            1,
            lambda context, output: output.set_value(
                [context.get_time() - context.get_discrete_state(self._heard).value()[0]]
            ),
            {self.discrete_state_ticket(self._heard), self.time_ticket()},
        )

    def _update(self, context, discrete_state):
        _step(
            discrete_state.get_mutable_value(self._history).reshape(-1, SAMPLE_SIZE),
            discrete_state.get_mutable_value(self._memory),
            discrete_state.get_mutable_value(self._estimate),
            discrete_state.get_mutable_value(self._disturbance),
            discrete_state.get_mutable_value(self._heard),
            read_vector(self._imu, context).reshape(-1, SAMPLE_SIZE),
            read_vector(self._corrections, context),
            read_vector(self._speeds, context),
            context.get_time(),
            self._model,
        )

    def _calc_filtered(self, context, output):
        _carry_forward(
            output.get_mutable_value(),
            context.get_discrete_state(self._history).value().reshape(-1, SAMPLE_SIZE),
            context.get_discrete_state(self._memory).value(),
            context.get_discrete_state(self._estimate).value(),
            context.get_discrete_state(self._heard).value(),
            read_vector(self._imu, context).reshape(-1, SAMPLE_SIZE),
            read_vector(self._speeds, context),
            context.get_time(),
            self._model,
        )


class _Model(NamedTuple):
    """The integrator's constants.

    Attributes:
        p_BI: where the sensor is mounted (m), (3,).
        ranges: of its angular velocity (rad/s) and specific force (m/s^2), (6,).
        period: of its samples (s).
        silent: time without a sample that is too long (s).
        wrench_by_squares: matrix from the rotors' squared speeds to [T, Mx, My, Mz], (4, r).
        inertia: mass (kg) and moments of inertia (kg m^2), (4,).
    """

    p_BI: np.ndarray
    ranges: np.ndarray
    period: float
    silent: float
    wrench_by_squares: np.ndarray
    inertia: np.ndarray


@compiled
def _step(history, memory, estimate, disturbance, heard, samples, corrections, speeds, now, model):
    """Takes up what the sensor has shown, and a correction; see StrapdownIntegrator.

    Args:
        history: samples, newest first, (n, 7); changed, as all states are.
        memory: a Navigation and the time of the correction that it goes on from, (18,).
        estimate: at the newest sample, (14,).
        disturbance: (m/s^2, in W), (3,).
        heard: time of the sensor's newest sound sample, the angular velocity since then, and how
            old samples are when they come, (5,).
        samples: of the sensor, newest first, (m, 7).
        corrections: vector of a Navigation, (17,).
        speeds: of the rotors (rad/s), (r,).
        now: (s).
        model: a _Model, as a tuple.
    """
    constants, last = _Model(*model), history[0, 0]
    thrust, count = _thrust_per_mass(speeds, constants), 0
    if not _is_stuck(samples, thrust, _bridges(history, heard)):
        count = remember(history, samples, constants.ranges)
    if count > 0:
        heard[0] = history[0, 0]
        heard[4] = max(now - heard[0], _FORGET * heard[4])
    count = _replace_silence(history, heard, count, now, memory, speeds, constants)
    _advance(history, memory, estimate, count, corrections, constants.p_BI)
    _smooth(disturbance, last, history, memory, thrust, constants.p_BI)


@compiled
def _carry_forward(result, history, memory, estimate, heard, samples, speeds, time, model):
    """Writes the estimate for a time (s), (14,), with the samples that are not in it yet.

    Args: see _step(); only the result changes.
    """
    constants = _Model(*model)
    assign(result, estimate)
    recent = history[: len(samples)].copy()
    if not _is_stuck(samples, _thrust_per_mass(speeds, constants), _bridges(history, heard)):
        remember(recent, samples, constants.ranges)
    if memory[0] >= 0.0 and recent[0, 0] > 0.0:
        state = as_navigation(carried_to(memory[:-1], recent, time))
        write_state(result, state, recent[0, 1:4] - state.gyro_bias, constants.p_BI)


@compilable
def _thrust_per_mass(speeds, constants):
    """Returns the rotors' thrust by the mass (m/s^2); a rotor without a speed has none."""
    total = 0.0
    for c, speed in zip(constants.wrench_by_squares[0], speeds):
        total += c / constants.inertia[0] * speed * speed if math.isfinite(speed) else 0.0
    return total


@compilable
def _bridges(history, heard):
    """Whether the newest sample was made up, because the sensor is silent."""
    return history[0, 0] > heard[0]


@compilable
def _is_stuck(samples, thrust, bridges):
    """Whether a sensor in flight shows the same again and again, to the last bit.

    With little thrust, by mass (m/s^2), the drone may stand; but not while samples are made up
    (``bridges``).
    """
    if not bridges and thrust < _FLYING * GRAVITY:
        return False
    for k in range(1, len(samples)):
        for j in range(1, SAMPLE_SIZE):
            if samples[k, j] != samples[0, j] or samples[k, 0] <= 0.0:
                return False
    return True


@compilable
def _replace_silence(history, heard, count, now, memory, speeds, constants):
    """Writes a sample as the rotors let it be expected, once the sensor is silent.

    With total thrust T and moments M of the rotors, mass m and moments of inertia J, Euler's
    equations give the angular velocity, and the specific force at p_BI follows:

        J dw/dt = M - w x J w,   f = [0, 0, T / m] + dw/dt x p_BI + w x (w x p_BI).

    What is made up is as old as the sensor's samples are when they come, so that its next one is
    newer. ``count`` samples are new; for the rest see _step().

    Returns:
        how many samples are new; none are written before anything is known, and on the ground.
    """
    state, expected = as_navigation(memory), heard[1:4]
    if count > 0:
        assign(expected, history[0, 1:4] - state.gyro_bias)
        return count
    wrench = np.zeros(4)
    for i in range(4):
        for j in range(len(speeds)):
            wrench[i] += constants.wrench_by_squares[i, j] * speeds[j] * speeds[j]
    mass, J, p_BI = constants.inertia[0], constants.inertia[1:], constants.p_BI
    if not memory[0] >= 0.0 or not all_finite(wrench):
        return 0
    turning = (wrench[1:] - cross(expected, J * expected)) / J
    expected += constants.period * turning
    # Once it has begun it goes on, with however little thrust.
    flies = _bridges(history, heard) or wrench[0] > _FLYING * GRAVITY * mass
    time = now - heard[4]
    if not flies or not now - heard[0] > constants.silent or not time > history[0, 0]:
        return 0
    f = cross(turning, p_BI) + cross(expected, cross(expected, p_BI))
    f[2] += wrench[0] / mass
    sample = np.empty((1, SAMPLE_SIZE))
    sample[0, 0] = time
    sample[0, 1:4] = expected + state.gyro_bias
    sample[0, 4:7] = f + state.accel_bias
    return remember(history, sample, _UNLIMITED)


@compilable
def _advance(history, memory, estimate, count, corrections, p_BI):
    """Takes up new samples, ``count`` of them, and a new correction; for the rest see _step()."""
    newest = history[0, 0]
    if all_finite(corrections) and corrections[0] > memory[-1]:
        assign(memory[:-1], carried_to(corrections, history, max(newest, corrections[0])))
        memory[-1] = corrections[0]
    elif count > 0 and memory[0] >= 0.0:
        assign(memory[:-1], carried_to(memory[:-1], history, newest))
    else:
        return
    state, w, averaged = as_navigation(memory), np.zeros(3), min(_AVERAGED, len(history))
    for k in range(averaged):
        w += history[k, 1:4] / averaged
    write_state(estimate, state, w - state.gyro_bias, p_BI)


@compilable
def _unexplained(state, sample, thrust, p_BI):
    """Returns the acceleration (m/s^2, in W) that a thrust per mass (m/s^2) does not explain."""
    w = sample[1:4] - state.gyro_bias
    f = sample[4:7] - state.accel_bias - cross(w, cross(w, p_BI))
    f[2] -= thrust
    return rotate(rotation_matrix(state.quaternion), f)


@compilable
def _smooth(disturbance, last, history, memory, thrust, p_BI):
    """Smooths the disturbance, (3,), with the samples since the last step's newest one.

    Args: see _step(); the time of that sample (s), and the rotors' thrust by mass (m/s^2).
    """
    if not memory[0] >= 0.0 or last < 0.0 or thrust < _FLYING * GRAVITY:
        return
    state = as_navigation(memory)
    for k in range(len(history) - 1, -1, -1):
        dt = history[k, 0] - last
        if dt <= 0.0:
            continue
        last = history[k, 0]
        share = 1.0 - math.exp(-dt / _TIME_CONSTANT)
        disturbance += share * (_unexplained(state, history[k], thrust, p_BI) - disturbance)
    length = math.sqrt(dot(disturbance, disturbance))
    disturbance *= min(1.0, _MAX_DISTURBANCE / max(length, 1e-9))
