"""A Kalman filter of the state, for the controller, that also estimates disturbances."""

import math
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np
from pydrake.math import DiscreteAlgebraicRiccatiEquation

from airrace.common.jit import all_finite, assign, compilable, compiled
from airrace.common.packing import Packing
from airrace.math.quaternion import integrate, rotation_matrix
from airrace.math.triples import rotation_rows
from airrace.math.vec3 import dot
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_or, read_vector
from airrace.vehicle import GRAVITY, Vehicle, load_vehicle
from airrace.vehicle.air import AIR_SIZE, STILL_VECTOR, as_air, drag_acceleration
from airrace.vehicle.free_body import at_constant_acceleration, linear_acceleration
from airrace.vehicle.state import STATE_SIZE, as_state

if TYPE_CHECKING:  # else an edit of it would have all machine code compiled anew
    from airrace.scenario import Scenario

# What the filter is tuned for; the first two are the original system's noise.
_POSITION_SIGMA = 0.005  # m
_VELOCITY_SIGMA = 0.3  # m/s, 3 % of 10 m/s
_ACCELERATION_NOISE = 0.1  # m/s^2 / sqrt(Hz), of the rotors' thrust
_DISTURBANCE_NOISE = 0.7  # m/s^2 / sqrt(s), how fast the disturbance wanders
MAX_DISTURBANCE = 8.0  # m/s^2
_GAP = 0.1  # s without an estimate, after which the filter begins anew
FLYING = 0.5  # of the weight: with less thrust, the ground may carry the drone


class FilterMemory(NamedTuple):
    """What the filter remembers, beside the disturbance."""

    time: float  #: to which it has predicted (s)
    newest: float  #: time of the newest estimate (s), negative before the first
    thrust: float  #: of the rotors, per mass (m/s^2)
    position: np.ndarray  #: p_WB then (m), (3,)
    velocity: np.ndarray  #: v_WB then (m/s), (3,)
    rest: np.ndarray  #: of the disturbance, without the drag that is known (m/s^2), (3,)


_NOTHING = FilterMemory(-1.0, -1.0, 0.0, np.zeros(3), np.zeros(3), np.zeros(3))


_PACKING = Packing(FilterMemory, position=3, velocity=3, rest=3)
_as_memory, _memory_vector = _PACKING.parts, _PACKING.vector


class StateFilter(LeafSystem):
    """A steady-state Kalman filter of position, velocity and disturbance.

    .. pydrake_system::

        name: StateFilter
        input_ports:
        - state_estimate
        - rotor_speeds
        - rotor_factors (may be left open: rotors are as in the drone's file)
        - air (may be left open: it is not known)
        output_ports:
        - filtered_estimate
        - disturbance

    ``state_estimate`` and ``filtered_estimate`` are of vehicle.State (14);
    ``rotor_speeds`` as measured (rad/s); ``rotor_factors`` see RotorLearner, ``air`` see
    AirLearner; ``disturbance`` (3) is the acceleration that rotors and gravity do not explain, by
    wind, drag, or a wrong mass (m/s^2, in the world). Of drag that is known it follows every
    change of the velocity; the rest is thought to wander.

    Noise on the velocity does not average out in flight: rotors answer with
    the square of a lagged speed, so that jitter in their command costs mean
    thrust. The filter predicts with the thrust of the rotors as they turn, so
    it holds in a tumble as it does on a trajectory, and a disturbance cannot
    wind up while they are at their limits. The outputs are carried forward from
    the newest estimate to the present, the attitude by its angular velocity.
    """

    def __init__(self, *, vehicle: Vehicle, state_rate: float, rate: float):
        """Constructs the filter.

        Args:
            vehicle: mass and rotors.
            state_rate: of the state estimate (Hz).
            rate: of updates (Hz).
        """
        LeafSystem.__init__(self)
        self._gain = kalman_gain(1.0 / state_rate)
        self._thrust_per_mass = vehicle.thrust_coefficients / vehicle.mass
        self._estimate = self.DeclareVectorInputPort("state_estimate", STATE_SIZE)
        self._ones = np.ones(len(vehicle.rotors))
        self._speeds = self.DeclareVectorInputPort("rotor_speeds", len(vehicle.rotors))
        self._factors = self.DeclareVectorInputPort("rotor_factors", len(vehicle.rotors))
        self._air = self.DeclareVectorInputPort("air", AIR_SIZE)
        self._memory = self.DeclareDiscreteState(_memory_vector(_NOTHING))
        self._disturbance = self.DeclareDiscreteState(3)
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / rate, 0.0, self._update)
        self.DeclareVectorOutputPort("filtered_estimate", STATE_SIZE, self._calc_estimate)
        self.DeclareStateOutputPort("disturbance", self._disturbance)

    @classmethod
    def from_scenario(cls, scenario: "Scenario") -> Self:
        """Returns the filter of a scenario."""
        return cls(
            vehicle=load_vehicle(scenario.drone)[0],
            state_rate=scenario.state_estimate.rate,
            rate=scenario.state_filter.rate,
        )

    def _update(self, context, discrete_state):
        _update(
            discrete_state.get_mutable_value(self._memory),
            discrete_state.get_mutable_value(self._disturbance),
            read_vector(self._estimate, context),
            read_vector(self._speeds, context),
            self._thrust_per_mass * read_or(self._ones, self._factors, context),
            self._gain,
            context.get_time(),
            read_or(STILL_VECTOR, self._air, context),
        )

    def _calc_estimate(self, context, output):
        _carry_forward(
            output.get_mutable_value(),
            read_vector(self._estimate, context),
            context.get_discrete_state(self._memory).value(),
            context.get_discrete_state(self._disturbance).value(),
            context.get_time(),
        )


class UnfilteredState(LeafSystem):
    """Takes the place of a StateFilter where nothing is to be smoothed or predicted.

    .. pydrake_system::

        name: UnfilteredState
        input_ports:
        - state_estimate
        output_ports:
        - filtered_estimate
        - disturbance

    ``filtered_estimate`` is the newest ``state_estimate``, as noisy and as old as it is;
    ``disturbance`` is zero. So the system of the Student AirRace paper had it.
    """

    def __init__(self) -> None:
        """Constructs the system."""
        LeafSystem.__init__(self)
        estimate = self.DeclareVectorInputPort("state_estimate", STATE_SIZE)
        self.DeclareVectorOutputPort(
            "filtered_estimate",
            STATE_SIZE,
            lambda context, output: output.set_value(read_vector(estimate, context)),
            {estimate.ticket()},
        )
        self.DeclareStateOutputPort("disturbance", self.DeclareDiscreteState(3))


def make_state_filter(scenario: "Scenario") -> StateFilter | UnfilteredState:
    """Returns the filter of a scenario, or what takes its place."""
    return (
        StateFilter.from_scenario(scenario) if scenario.state_filter.enabled else UnfilteredState()
    )


@compilable
def specific_thrust(thrust_per_mass: np.ndarray, speeds: np.ndarray) -> float:
    """Returns the rotors' thrust by the mass (m/s^2); a rotor without a speed has none.

    Args: thrust_per_mass: of each rotor, per squared speed (m), (n,). speeds: (rad/s), (n,).
    """
    total = 0.0
    for c, speed in zip(thrust_per_mass, speeds):
        total += c * speed * speed if math.isfinite(speed) else 0.0
    return total


@compilable
def _predict(
    memory: FilterMemory,
    quaternion: np.ndarray,
    thrust: float,
    disturbance: np.ndarray,
    time: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Returns position and velocity at a time (s), at constant acceleration.

    Args: quaternion: of R_WB, (4,). thrust: per mass (m/s^2). disturbance: see StateFilter.
    """
    a = linear_acceleration(rotation_rows(quaternion), (0.0, 0.0, thrust), disturbance)
    p, v = at_constant_acceleration(memory.position, memory.velocity, a, time - memory.time)
    return np.array(p), np.array(v)


@compiled
def _carry_forward(result, estimate, memory, disturbance, time):
    """Writes the estimate for a time (s), (14,); the newest one if that is not finite."""
    assign(result, estimate)
    m, state = _as_memory(memory), as_state(result)
    if m.newest >= 0.0 and all_finite(estimate):
        quaternion = integrate(state.quaternion, state.angular_velocity, time - state.time)
        position, velocity = _predict(m, quaternion, m.thrust, disturbance, time)
        result[0] = time
        assign(state.quaternion, quaternion)
        assign(state.position, position)
        assign(state.velocity, velocity)


@compiled
def _update(memory, disturbance, estimate, speeds, thrust_per_mass, gain, now, air):
    """Predicts and corrects by an estimate, if it is new; else predicts the present.

    Args:
        memory: vector of a FilterMemory, (12,); changed.
        disturbance: see StateFilter, (3,); changed.
        estimate: (14,).
        speeds, thrust_per_mass: see specific_thrust().
        gain: see kalman_gain().
        now: (s).
        air: vector of an Air, (7,).
    """
    m, state = _as_memory(memory), as_state(estimate)
    if not all_finite(estimate):
        return  # the prediction goes on from the last that was
    thrust = specific_thrust(thrust_per_mass, speeds)
    time, p, v, rest = state.time, state.position.copy(), state.velocity.copy(), m.rest.copy()
    z_B = rotation_matrix(state.quaternion)[:, 2]
    assign(disturbance, rest + drag_acceleration(m.velocity, z_B, as_air(air)))
    is_new, begins = time > m.newest, m.newest < 0.0 or time > m.newest + _GAP
    if not begins:
        until = time if is_new else now
        quaternion = integrate(state.quaternion, state.angular_velocity, until - time)
        p, v = _predict(m, quaternion, thrust, disturbance, until)
        if is_new:
            e_p, e_v = state.position - p, state.velocity - v
            p, v = p + gain[0, 0] * e_p + gain[0, 1] * e_v, v + gain[1, 0] * e_p + gain[1, 1] * e_v
            if thrust >= FLYING * GRAVITY:
                rest += gain[2, 0] * e_p + gain[2, 1] * e_v
            length = math.sqrt(dot(rest, rest))
            rest *= min(1.0, MAX_DISTURBANCE / max(length, 1e-9))
    predicted_to = time if is_new or begins else now
    numbers = np.array((predicted_to, max(time, m.newest), thrust))
    assign(memory, np.concatenate((numbers, p, v, rest)))
    assign(disturbance, rest + drag_acceleration(v, z_B, as_air(air)))


def kalman_gain(dt: float) -> np.ndarray:
    """Returns the steady-state gain on errors of position and velocity, (3, 2).

    Its rows correct position, velocity and disturbance.

    Args: dt: between two estimates (s).
    """
    A = np.array([[1.0, dt, dt * dt / 2], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])
    # Of white noise all through dt; if held over dt, Q would be singular, and
    # by rounding not even positive semidefinite.
    Q = np.zeros((3, 3))
    for order, density in ((2, _ACCELERATION_NOISE), (3, _DISTURBANCE_NOISE)):
        powers = np.arange(order)[::-1]
        factorials = np.array([1.0, 1.0, 2.0])[powers]
        sums = powers[:, None] + powers + 1
        Q[:order, :order] += density**2 * dt**sums / sums / np.outer(factorials, factorials)
    R = np.diag([_POSITION_SIGMA**2, _VELOCITY_SIGMA**2])
    C = np.eye(3)[:2]
    # The filter's Riccati equation is the regulator's of the transposed system.
    P = DiscreteAlgebraicRiccatiEquation(A.T, C.T, Q, R)
    return P @ C.T @ np.linalg.inv(C @ P @ C.T + R)
