"""Learns in flight how much thrust each rotor really has."""

from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from airrace.common.jit import all_finite
from airrace.common.packing import Packing
from airrace.math.quaternion import rotation_matrix
from airrace.math.vec3 import dot
from airrace.systems.estimation.state_filter import FLYING
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_or, read_vector
from airrace.vehicle import GRAVITY, Vehicle, load_vehicle
from airrace.vehicle.air import AIR_SIZE, STILL_VECTOR, as_air, drag_acceleration
from airrace.vehicle.state import STATE_SIZE, as_state

if TYPE_CHECKING:  # else an edit of it would have all machine code compiled anew
    from airrace.scenario import Scenario

_MEMORY = 15.0  # s, over which old flight is forgotten to 1 / e
_LEAST = 1.0  # s of flight, before which nothing is said
_TAKE_OFF = 1.0  # s that do not count: disturbances still show that the ground carried the drone
_MOST = 0.2  # that a factor is off one: more is another fault
_STEP = 0.005  # factors are told in steps, so that who computes with them need not do it anew


class LearnerMemory(NamedTuple):
    """What the learner remembers."""

    flown: float  #: time that counts (s), negative before the first
    thrusts: np.ndarray  #: mean of the rotors' thrusts, as their speeds promise (N), (n,)
    missing: np.ndarray  #: mean of what would explain the disturbances (N), (n,)


class RotorLearner(LeafSystem):
    """Compares what the rotors should do to the drone with what happens to it.

    .. pydrake_system::

        name: RotorLearner
        input_ports:
        - filtered_estimate
        - disturbance
        - disturbance_moment
        - rotor_speeds
        - air (may be left open: it is not known)
        output_ports:
        - rotor_factors

    Inputs are as their systems describe them. ``rotor_factors`` (n) is by what the thrust of each
    rotor, as the drone's file promises it, is to be multiplied: 0.9 for a worn propeller, and 0.95
    for each if the drone is by that much too heavy.

    Thrusts T_i that the speeds promise, with the factors k_i that are known so far, make the wrench
    B (k T). What is seen beside it, the force of the disturbance along the body's z axis and the
    disturbance's moment, is B e with the least e. So the factors are 1 + mean(e + (k - 1) T) /
    mean(T), over the last 15 s. Drag that is known is none of it. Other wind and drag blow from all
    sides on a lap; what is left of them counts as a weakness of the rotors, which is what it is to
    a plan. The greatest angular accelerations cancel in the mean, so an error of the inertia does
    not show.
    """

    RATE = 20.0  #: Hz, in a race

    def __init__(self, *, vehicle: Vehicle, rate: float):
        """Args: vehicle: mass and rotors, as in its file. rate: of updates (Hz)."""
        LeafSystem.__init__(self)
        n = len(vehicle.rotors)
        self._mass, self._dt = vehicle.mass, 1.0 / rate
        self._coefficients = vehicle.thrust_coefficients
        self._inverse = np.ascontiguousarray(np.linalg.pinv(vehicle.allocation))
        packing = Packing(LearnerMemory, thrusts=n, missing=n)
        self._parts, self._vector = packing.parts, packing.vector
        self._estimate = self.DeclareVectorInputPort("filtered_estimate", STATE_SIZE)
        self._disturbance = self.DeclareVectorInputPort("disturbance", 3)
        self._moment = self.DeclareVectorInputPort("disturbance_moment", 3)
        self._speeds = self.DeclareVectorInputPort("rotor_speeds", n)
        self._air = self.DeclareVectorInputPort("air", AIR_SIZE)
        self.DeclareDiscreteState(
            packing.vector(LearnerMemory(-_TAKE_OFF, np.zeros(n), np.zeros(n)))
        )
        factors = self.DeclareDiscreteState(np.ones(n))
        self.DeclarePeriodicDiscreteUpdateEvent(self._dt, 0.0, self._update)
        self.DeclareStateOutputPort("rotor_factors", factors)

    @classmethod
    def from_scenario(cls, scenario: "Scenario") -> Self:
        """Returns the learner of a scenario."""
        return cls(vehicle=load_vehicle(scenario.drone)[0], rate=cls.RATE)

    def _update(self, context, discrete_state):
        speeds = read_vector(self._speeds, context)
        estimate = read_vector(self._estimate, context)
        disturbance = read_vector(self._disturbance, context)
        moment = read_vector(self._moment, context)
        if not all(map(all_finite, (speeds, estimate, disturbance, moment))):
            return
        thrusts = self._coefficients * speeds**2
        if thrusts.sum() < FLYING * GRAVITY * self._mass:
            return
        state, air = as_state(estimate), as_air(read_or(STILL_VECTOR, self._air, context))
        z_B = rotation_matrix(state.quaternion)[:, 2]
        rest = disturbance - drag_acceleration(state.velocity, z_B, air)
        wrench = np.array((self._mass * dot(rest, z_B), *moment))
        memory = discrete_state.get_mutable_value(0)
        factors = discrete_state.get_mutable_value(1)
        m, missing = self._parts(memory), self._inverse @ wrench + (factors - 1.0) * thrusts
        flown = m.flown + self._dt
        if flown <= 0.0:
            memory[:] = self._vector(m._replace(flown=flown))
            return
        share = self._dt / min(flown, _MEMORY)  # a plain mean at first
        means = (
            before + share * (now - before)
            for before, now in ((m.thrusts, thrusts), (m.missing, missing))
        )
        memory[:] = self._vector(LearnerMemory(flown, *means))
        if flown >= _LEAST:
            m = self._parts(memory)
            off = np.clip(m.missing / m.thrusts, -_MOST, _MOST)
            factors[:] = 1.0 + _STEP * np.round(off / _STEP)
