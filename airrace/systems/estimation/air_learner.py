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
from airrace.vehicle.air import AIR_SIZE, Air, air_vector, drag_acceleration
from airrace.vehicle.state import STATE_SIZE, as_state

if TYPE_CHECKING:  # else an edit of it would have all machine code compiled anew
    from airrace.scenario import Scenario

# Standard deviations before anything is known: of what a file says, that it all acts, and that it
# is wrong by itself; in units of an Air.
_ACTS, _WRONG, _LEAST = 1.0, 0.2, np.array([0.01, 0.001])
_WIND = 4.0  # m/s, on each axis
# By how much an Air may change in a second.
_DRIFT = np.array([0.003, 0.0003, 0.2, 0.2, 0.1])
# m/s^2, of a disturbance 10 times a second, whose gusts last for seconds; and along the thrust,
# where rotors may be wrong as well.
_NOISE, _ALONG = 2.1, 6.4
_MOST = np.array([1.0, 0.05, 15.0, 15.0, 15.0])
# m/s^2 at 10 m/s: less drag is not told, and from the second on all of it.
_NONE, _ALL, _AT = 0.3, 0.6, 10.0


class AirMemory(NamedTuple):
    """What the learner believes."""

    mean: np.ndarray  #: an Air's linear and quadratic drag and its wind, (5,)
    covariance: np.ndarray  #: (5, 5)


_N = 5  # of what is learnt
_PACKING = Packing(AirMemory, mean=_N, covariance=(_N, _N))
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

    Inputs are as their systems describe them. ``air`` (7) is the vector of an Air, at first STILL:
    where there is hardly any drag, it stays so.

    A disturbance d at a velocity v is drag, see Air, and a rest that is thought to be noise:
    gusts, and what the rotors are wrong by. Drag that is the same in all directions, and what there
    is more along the thrust, is what a plan can count on: see thrust_vectors(). How it grows with
    the speed is, at first, as in the drone's file, all of it or none; by how much the drag along
    the thrust differs is always as in the file. Estimating drag of multirotors from flight:
    Faessler, Franchi and Scaramuzza, "Differential flatness of quadrotor dynamics subject to rotor
    drag" (RA-L 2018).
    """

    RATE = 10.0  #: Hz, in a race

    def __init__(self, *, vehicle: Vehicle, rate: float):
        """Args: vehicle: mass, rotors and drag, as in its file. rate: of updates (Hz)."""
        LeafSystem.__init__(self)
        self._thrust_per_mass = vehicle.thrust_coefficients / vehicle.mass
        self._dt = 1.0 / rate
        linear, quadratic = np.array(vehicle.drag.linear), np.array(vehicle.drag.quadratic)
        file = np.array([linear[:2].mean(), quadratic[:2].mean()])
        # How much more of each there is along z, as a share.
        self._more = np.array([linear[2], quadratic[2]]) / np.maximum(file, 1e-9) - 1.0
        self._more *= file > 0.0
        covariance = np.diag([0.0, 0.0, *[_WIND**2] * 3])
        covariance[:2, :2] = _ACTS**2 * np.outer(file, file) / vehicle.mass**2
        covariance[:2, :2] += np.diag((_WRONG * file / vehicle.mass) ** 2 + _LEAST**2)
        self._estimate = self.DeclareVectorInputPort("filtered_estimate", STATE_SIZE)
        self._disturbance = self.DeclareVectorInputPort("disturbance", 3)
        self._speeds = self.DeclareVectorInputPort("rotor_speeds", len(vehicle.rotors))
        first = AirMemory(np.zeros(_N), covariance)
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
        air = self._air_of(mean)
        H = _drag_gradient(state.velocity, z_B, air, self._more)
        noise = _NOISE**2 * np.eye(3) + _ALONG**2 * np.outer(z_B, z_B)
        gain = np.linalg.solve(H @ P @ H.T + noise, H @ P).T
        mean += gain @ (disturbance - drag_acceleration(state.velocity, z_B, air))
        np.clip(mean, [0.0, 0.0, *-_MOST[2:]], _MOST, out=mean)
        memory.covariance[:] = P - gain @ H @ P
        memory.covariance[:] = 0.5 * (memory.covariance + memory.covariance.T)
        told = mean.copy()
        told[:2] *= _told_share(self._air_of(mean))
        discrete_state.get_mutable_value(1)[:] = air_vector(self._air_of(told))

    def _air_of(self, mean: np.ndarray) -> Air:
        """Returns the air that an AirMemory's mean is of."""
        return Air(mean[0], mean[1], mean[2:], *self._more * mean[:2])


def _drag_gradient(velocity: np.ndarray, z_B: np.ndarray, air: Air, more: np.ndarray) -> np.ndarray:
    """Returns the derivatives of drag_acceleration() by an AirMemory's mean, (3, 5).

    Args: velocity, z_B: see there. air: of that mean. more: drag along z_B, as a share, (2,).
    """
    u = velocity - air.wind
    speed, along = max(float(np.linalg.norm(u)), 1e-3), float(u @ z_B)
    by_wind = (air.linear + air.quadratic * speed) * np.eye(3)
    by_wind += air.quadratic / speed * np.outer(u, u)
    by_wind += (air.axial_linear + air.axial_quadratic * speed) * np.outer(z_B, z_B)
    by_wind += air.axial_quadratic * along / speed * np.outer(z_B, u)
    by_drag = [-scale * (u + k * along * z_B) for scale, k in zip((1.0, speed), more)]
    return np.column_stack([*by_drag, by_wind])


def _told_share(air: Air) -> float:
    """Returns the share of the drag that is told: hardly any is none."""
    drag = air.linear * _AT + air.quadratic * _AT**2
    return min(max((drag - _NONE) / (_ALL - _NONE), 0.0), 1.0)
