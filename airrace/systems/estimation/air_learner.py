"""Learns in flight what the air does: the drone's drag, and the mean wind."""

from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from airrace.common.jit import all_finite
from airrace.common.packing import Packing
from airrace.math.quaternion import rotation_matrix
from airrace.systems.estimation.state_filter import FLYING, specific_thrust
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_vector
from airrace.vehicle import GRAVITY, Vehicle, load_vehicle
from airrace.vehicle.air import AIR_SIZE, Air, air_vector, as_air, drag_acceleration
from airrace.vehicle.state import STATE_SIZE, as_state

if TYPE_CHECKING:  # else an edit of it would have all machine code compiled anew
    from airrace.scenario import Scenario

# Standard deviations before anything is known: of what a file says, that it all acts, and that it
# is wrong by itself; in units of an Air.
_ACTS, _WRONG, _LEAST = 1.0, 0.2, np.array([0.01, 0.001])
_WIND = 4.0  # m/s, on each axis
# By how much an Air may change in a second.
_DRIFT = np.array([0.003, 0.0003, 0.2, 0.2, 0.1])
# m/s^2, of a disturbance 20 times a second, whose gusts last for seconds; and along the thrust,
# where rotors may be wrong as well.
_NOISE, _ALONG = 3.0, 9.0
_MOST = np.array([1.0, 0.05, 15.0, 15.0, 15.0])
# m/s^2 at 10 m/s: less drag is not told, and from the second on all of it.
_NONE, _ALL, _AT = 0.3, 0.6, 10.0


class AirMemory(NamedTuple):
    """What the learner believes."""

    mean: np.ndarray  #: vector of an Air, (5,)
    covariance: np.ndarray  #: (5, 5)


_PACKING = Packing(AirMemory, mean=AIR_SIZE, covariance=(AIR_SIZE, AIR_SIZE))
_as_memory, _memory_vector = _PACKING.parts, _PACKING.vector


class AirLearner(LeafSystem):
    """An extended Kalman filter of drag and wind, from the disturbances that a drone meets.

    .. pydrake_system::

        name: AirLearner
        input_ports:
        - filtered_estimate
        - disturbance
        - rotor_speeds
        output_ports:
        - air

    Inputs are as their systems describe them. ``air`` (5) is the vector of an Air, at first STILL:
    where there is hardly any drag, it stays so.

    A disturbance d at a velocity v is drag, see Air, and a rest that is thought to be noise:
    gusts, and what the rotors are wrong by. Drag that is the same in all directions is what a plan
    can count on: see thrust_vectors(). How it grows with the speed is, at first, as in the drone's
    file, all of it or none. Estimating drag of multirotors from flight: Faessler, Franchi and
    Scaramuzza, "Differential flatness of quadrotor dynamics subject to rotor drag" (RA-L 2018).
    """

    RATE = 20.0  #: Hz, in a race

    def __init__(self, *, vehicle: Vehicle, rate: float):
        """Args: vehicle: mass, rotors and drag, as in its file. rate: of updates (Hz)."""
        LeafSystem.__init__(self)
        self._thrust_per_mass = vehicle.thrust_coefficients / vehicle.mass
        self._dt = 1.0 / rate
        file = np.array([np.mean(vehicle.drag.linear), np.mean(vehicle.drag.quadratic)])
        covariance = np.diag([0.0, 0.0, *[_WIND**2] * 3])
        covariance[:2, :2] = _ACTS**2 * np.outer(file, file) / vehicle.mass**2
        covariance[:2, :2] += np.diag((_WRONG * file / vehicle.mass) ** 2 + _LEAST**2)
        self._estimate = self.DeclareVectorInputPort("filtered_estimate", STATE_SIZE)
        self._disturbance = self.DeclareVectorInputPort("disturbance", 3)
        self._speeds = self.DeclareVectorInputPort("rotor_speeds", len(vehicle.rotors))
        first = AirMemory(np.zeros(AIR_SIZE), covariance)
        self.DeclareDiscreteState(_memory_vector(first))
        air = self.DeclareDiscreteState(AIR_SIZE)
        self.DeclarePeriodicDiscreteUpdateEvent(self._dt, 0.0, self._update)
        self.DeclareStateOutputPort("air", air)

    @classmethod
    def from_scenario(cls, scenario: "Scenario") -> Self:
        """Returns the learner of a scenario."""
        return cls(vehicle=load_vehicle(scenario.drone)[0], rate=cls.RATE)

    def _update(self, context, discrete_state):
        speeds = read_vector(self._speeds, context)
        estimate = read_vector(self._estimate, context)
        disturbance = read_vector(self._disturbance, context)
        if not all(map(all_finite, (speeds, estimate, disturbance))):
            return
        if specific_thrust(self._thrust_per_mass, speeds) < FLYING * GRAVITY:
            return
        state = as_state(estimate)
        z_B = rotation_matrix(state.quaternion)[:, 2]
        memory = _as_memory(discrete_state.get_mutable_value(0))
        mean, P = memory.mean, memory.covariance + np.diag(_DRIFT**2 * self._dt)
        H = _drag_gradient(state.velocity, as_air(mean))
        noise = _NOISE**2 * np.eye(3) + _ALONG**2 * np.outer(z_B, z_B)
        gain = np.linalg.solve(H @ P @ H.T + noise, H @ P).T
        mean += gain @ (disturbance - drag_acceleration(state.velocity, as_air(mean)))
        np.clip(mean, [0.0, 0.0, *-_MOST[2:]], _MOST, out=mean)
        memory.covariance[:] = P - gain @ H @ P
        memory.covariance[:] = 0.5 * (memory.covariance + memory.covariance.T)
        discrete_state.get_mutable_value(1)[:] = air_vector(_told(as_air(mean)))


def _drag_gradient(velocity: np.ndarray, air: Air) -> np.ndarray:
    """Returns the derivatives of drag_acceleration() by the vector of an Air, (3, 5)."""
    u = velocity - air.wind
    speed = max(float(np.linalg.norm(u)), 1e-3)
    by_wind = (air.linear + air.quadratic * speed) * np.eye(3)
    by_wind += air.quadratic / speed * np.outer(u, u)
    return np.column_stack([-u, -speed * u, by_wind])


def _told(air: Air) -> Air:
    """Returns the part of an Air that is told: hardly any drag is none."""
    drag = air.linear * _AT + air.quadratic * _AT**2
    share = min(max((drag - _NONE) / (_ALL - _NONE), 0.0), 1.0)
    return Air(share * air.linear, share * air.quadratic, air.wind)
