"""The gyroscope and the accelerometer."""

import functools
import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from airrace.common.jit import assign, compiled
from airrace.common.packing import Packing
from airrace.math.random import NoiseSequence
from airrace.math.triples import (
    added,
    cross,
    difference,
    dot,
    integrate,
    rotate,
    rotate_back,
    rotation_between,
    rotation_rows,
)
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_vector
from airrace.systems.seed import declare_seed
from airrace.systems.sensing.imu_samples import AT_SAMPLE, NO_SAMPLES, SAMPLE_SIZE, insert
from airrace.systems.sensing.state_estimate import plant_lead
from airrace.vehicle import GRAVITY
from airrace.vehicle.imu_errors import ImuErrors, axis_matrices, turn_on_biases
from airrace.vehicle.sensor_failures import IMU_FAILURES, ImuFailure, failure_at
from airrace.vehicle.state import STATE_SIZE, as_plant_state

_LOST, _NAN, _STUCK, _SATURATED = range(len(IMU_FAILURES))
_WORKS = -1  # in the place of these


class ImuMemory(NamedTuple):
    """What the sensor remembers from one sample to the next."""

    quaternion: np.ndarray  #: of R_WB at the end of the last sample, of length 1, (4,)
    velocity: np.ndarray  #: of the sensor in W then (m/s), (3,)
    biases: np.ndarray  #: of gyroscope (rad/s) and accelerometer (m/s^2), (6,)
    late: np.ndarray  #: samples that cannot be read yet, newest first, (7 n,)


_PACKING = Packing(ImuMemory, quaternion=4, velocity=3, biases=6, late=-1)
_as_memory, _memory_vector = _PACKING.parts, _PACKING.vector


class ImuModel(NamedTuple):
    """The sensor's constants."""

    period: float  #: of the samples, T (s)
    position: np.ndarray  #: p_BI of the sensor in the body (m), (3,)
    #: From what is true to what is shown, of gyroscope and accelerometer, (2, 3, 3).
    axes: np.ndarray
    noise: np.ndarray  #: standard deviations of a sample's noise, (6,): 3 (rad/s), 3 (m/s^2)
    walk: np.ndarray  #: standard deviations of the biases' change over a period, (6,), likewise
    ranges: np.ndarray  #: the greatest values that are shown, (6,), likewise
    time_offset: float  #: by which the time of a sample is late (s)


class Imu(LeafSystem):
    """An inertial measurement unit: gyroscope and accelerometer, whose axes are the body's.

    .. pydrake_system::

        name: Imu
        input_ports:
        - state
        - seed (may be left open)
        output_ports:
        - imu

    ``state`` is the plant's floating-base state (13), see vehicle.State; ``seed``: see SeedSource.
    ``imu`` (70) are the newest ten ImuSamples. A sample is the mean over a period, from where the
    drone is at its two ends: with the rotation vector log() of a rotation, and v of the sensor,

        w = log(R_WB(t - T)^T R_WB(t)) / T,    f = R_WB(t - T)^T (v(t) - v(t - T) - g T) / T,

    so that nothing is lost between samples. To these come the errors of ImuErrors: shown is
    (I + E) x + bias + noise, within the sensor's range.

    While the sensor fails, there are no samples at all, or wrong ones: see ImuFailure. Samples
    after it are as they would have been without.

    The first sample ends one period after the start. A system that is updated at the time when a
    sample ends, as the controller is, sees the sample before it: that is a period of delay, to
    which the latency of ImuErrors comes.

    Between its steps a discrete plant shows the state at the end of the step: attitudes go back
    from there to the end of the sample, as in StateEstimate. Drake's plant lets the length of
    its quaternion drift; here it is made 1 before it is used.
    """

    def __init__(
        self,
        *,
        rate: float,
        errors: ImuErrors | None = None,
        position: Sequence[float] = (0.0, 0.0, 0.0),
        failures: Iterable[ImuFailure] = (),
        seed: int = 0,
        state_period: float = 0.0,
    ):
        """Constructs the sensor.

        Args:
            rate: samples per second (Hz).
            errors: of the sensor; by default, none.
            position: p_BI, of the sensor in the body (m).
            failures: when it fails, and how.
            seed: of all that is random in the errors, if the port is left open.
            state_period: of the plant's steps (s); 0 if its state is continuous.
        """
        LeafSystem.__init__(self)
        errors = errors or ImuErrors()
        period = 1.0 / rate
        self._rate, self._state_period = rate, state_period
        self._failures = tuple(failures)
        self._position = np.array(position, float)
        model = ImuModel(
            period,
            self._position,
            np.tile(np.eye(3), (2, 1, 1)),
            np.repeat([errors.gyro_noise, errors.accelerometer_noise], 3) / math.sqrt(period),
            np.repeat([errors.gyro_walk, errors.accelerometer_walk], 3) * math.sqrt(period),
            np.repeat([errors.gyro_range, errors.accelerometer_range], 3),
            errors.time_offset,
        )

        @functools.lru_cache(maxsize=4)
        def model_of(seed):
            return tuple(model._replace(axes=axis_matrices(errors, seed)))

        self._errors, self._model = errors, model_of
        self._noise = NoiseSequence.of_seeds("imu", 12)
        self._seed = declare_seed(self, seed)
        self._state = self.DeclareVectorInputPort("state", STATE_SIZE - 1)
        self._shown = self.DeclareDiscreteState(NO_SAMPLES)
        memory = ImuMemory(
            quaternion=np.zeros(4),  # until it starts
            velocity=np.zeros(3),
            biases=np.zeros(6),
            late=np.tile(NO_SAMPLES[:SAMPLE_SIZE], round(errors.latency * rate)),
        )
        self._memory = self.DeclareDiscreteState(_memory_vector(memory))
        self.DeclareStateOutputPort("imu", self._shown)
        self.DeclareInitializationDiscreteUpdateEvent(self._start)
        # Without an offset, its times are those of other systems of its rate to the last bit.
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._sample)

    def _start(self, context, discrete_state):
        memory, time = discrete_state.get_mutable_value(self._memory), context.get_time()
        started = _as_memory(memory).quaternion.any()
        if started and time > 0.0:
            return  # a flight that goes on
        _as_memory(memory).biases[:] = turn_on_biases(self._errors, self._seed(context))
        lead = plant_lead(time, self._state_period)
        _remember(memory, read_vector(self._state, context), lead, self._position)

    def _sample(self, context, discrete_state):
        time = context.get_time()
        if time == 0.0:
            return self._start(context, discrete_state)
        seed = self._seed(context)
        _sample(
            discrete_state.get_mutable_value(self._shown),
            discrete_state.get_mutable_value(self._memory),
            read_vector(self._state, context),
            time,
            plant_lead(time, self._state_period),
            self._noise(seed)[round(time * self._rate)],
            self._failure(time),
            self._model(seed),
        )

    def _failure(self, time):
        kind = failure_at(self._failures, time)
        return _WORKS if kind is None else IMU_FAILURES.index(kind)


@compiled
def _remember(memory, plant_state, lead, position):
    """Writes attitude and velocity of the sensor into its memory; see _sample()."""
    memory = _as_memory(memory)
    _, q, _, w, v = as_plant_state(plant_state)
    q = integrate(q, w, -lead)
    assign(memory.quaternion, q)
    assign(memory.velocity, added(v, 1.0, cross(w, rotate(rotation_rows(q), position))))


@compiled
def _sample(shown, memory, plant_state, time, lead, noise, failure, model):
    """Takes a sample.

    Args:
        shown: the samples that can be read, newest first, (70,); changed.
        memory: vector of an ImuMemory, (13 + 7 n,); changed.
        plant_state: (13,), and by how much it is ahead of the time: lead (s).
        time: of the end of the sample (s).
        noise: standard normal numbers, (12,), of the sample and of the biases.
        failure: _WORKS, or what is wrong with this sample.
        model: an ImuModel, as a tuple.
    """
    period, position, axes, sigmas, walk, ranges, time_offset = model
    before = _as_memory(memory.copy())
    _remember(memory, plant_state, lead, position)
    after = _as_memory(memory)
    # What an ideal sensor shows.
    x, y, z = rotation_between(before.quaternion, after.quaternion)
    dv = difference(after.velocity, before.velocity)
    a = (dv[0] / period, dv[1] / period, dv[2] / period + GRAVITY)
    specific_force = rotate_back(rotation_rows(before.quaternion), a)
    motion = (x / period, y / period, z / period), specific_force
    biases, late = after.biases, after.late
    row = np.empty(SAMPLE_SIZE)
    row[AT_SAMPLE.time], values = time + time_offset, row[1:]
    for i in range(6):
        value = dot(axes[i // 3, i % 3], motion[i // 3]) + biases[i] + sigmas[i] * noise[i]
        values[i] = min(max(value, -ranges[i]), ranges[i])
        biases[i] += walk[i] * noise[6 + i]
    last = late if len(late) else shown
    if failure == _LOST:
        row[AT_SAMPLE.time] = -1.0
    elif failure == _NAN:
        values[:] = np.nan
    elif failure == _STUCK:
        values[:] = last[1:SAMPLE_SIZE]
    elif failure == _SATURATED:
        values[:] = ranges
    if len(late):
        newest = row
        row = late[-SAMPLE_SIZE:].copy()
        insert(late.reshape((-1, SAMPLE_SIZE)), newest)
    if row[AT_SAMPLE.time] >= 0.0:
        insert(shown.reshape((-1, SAMPLE_SIZE)), row)
