"""What turns the drone beside its rotors, as they are thought to be: a disturbance observer."""

import math
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from airrace.common.jit import all_finite, assign, compiled
from airrace.common.packing import Packing
from airrace.math.quaternion import rotation_matrix
from airrace.math.vec3 import cross, rotate
from airrace.systems.estimation.state_filter import FLYING, specific_thrust
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_or, read_vector
from airrace.vehicle import GRAVITY, Vehicle, load_vehicle
from airrace.vehicle.state import STATE_SIZE, as_state

if TYPE_CHECKING:  # else an edit of it would have all machine code compiled anew
    from airrace.scenario import Scenario

_GAIN = 3.0  # 1/s: slower than the controller, quicker than a gust
_GAP = 0.1  # s without an estimate, after which the observer begins anew
_MOST = 0.1  # of the moment that the rotors of one side can make


class ObserverMemory(NamedTuple):
    """What the observer remembers, beside the moment."""

    time: float  #: of the newest estimate (s), negative before the first
    momentum: np.ndarray  #: J w that rotors and the moment found so far explain (N m s, in B), (3,)


_PACKING = Packing(ObserverMemory, momentum=3)
_as_memory, _memory_vector = _PACKING.parts, _PACKING.vector


class MomentObserver(LeafSystem):
    """A momentum observer of the moment that rotors do not explain.

    .. pydrake_system::

        name: MomentObserver
        input_ports:
        - filtered_estimate
        - rotor_speeds
        - rotor_factors (may be left open: rotors are as in the drone's file)
        output_ports:
        - disturbance_moment

    ``filtered_estimate`` is a vehicle.State (14), ``rotor_speeds`` as measured (rad/s),
    ``rotor_factors`` see RotorLearner;
    ``disturbance_moment`` (3) is in B (N m). It is what rotors that are not all equal make, or a
    centre of mass that is elsewhere, or what hits one side. A controller that leans against it
    does not fly beside its reference.

    With momentum p = J w and the rotors' moment M, the residual r = K (p - integral of
    (M - w x J w + r)) tends to the moment with the time constant 1 / K: De Luca and Mattone,
    "Actuator failure detection and isolation using generalized momenta", ICRA 2003. It takes no
    derivative of a noisy angular velocity. It waits while the ground may carry the drone.
    """

    #: Hz, in a race: at every other estimate of the filter, so that all are equally old.
    RATE = 125.0

    def __init__(self, *, vehicle: Vehicle, rate: float):
        """Args: vehicle: inertia, mass and rotors. rate: of updates (Hz)."""
        LeafSystem.__init__(self)
        thrusts = vehicle.thrust_coefficients
        self._inertia = np.array(vehicle.inertia)
        self._moments = vehicle.allocation[1:] * thrusts
        self._thrust_per_mass = thrusts / vehicle.mass
        self._most = _MOST * np.abs(vehicle.allocation[1:]) @ vehicle.max_thrusts / 2.0
        self._estimate = self.DeclareVectorInputPort("filtered_estimate", STATE_SIZE)
        self._ones = np.ones(len(vehicle.rotors))
        self._speeds = self.DeclareVectorInputPort("rotor_speeds", len(vehicle.rotors))
        self._factors = self.DeclareVectorInputPort("rotor_factors", len(vehicle.rotors))
        self._memory = self.DeclareDiscreteState(_memory_vector(ObserverMemory(-1.0, np.zeros(3))))
        self._moment = self.DeclareDiscreteState(3)
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / rate, 0.0, self._update)
        self.DeclareStateOutputPort("disturbance_moment", self._moment)

    @classmethod
    def from_scenario(cls, scenario: "Scenario") -> Self:
        """Returns the observer of a scenario."""
        return cls(vehicle=load_vehicle(scenario.drone)[0], rate=cls.RATE)

    def _update(self, context, discrete_state):
        _observe(
            discrete_state.get_mutable_value(self._memory),
            discrete_state.get_mutable_value(self._moment),
            read_vector(self._estimate, context),
            read_vector(self._speeds, context),
            self._inertia,
            self._moments * read_or(self._ones, self._factors, context),
            self._thrust_per_mass,
            self._most,
        )


@compiled
def _observe(memory, moment, estimate, speeds, inertia, moments, thrust_per_mass, most):
    """Updates the moment by an estimate.

    Args:
        memory: vector of an ObserverMemory, (4,); changed.
        moment: r, (3,); changed.
        estimate: (14,).
        speeds: of the rotors (rad/s), (n,).
        inertia: J, (3,).
        moments: of each rotor by its squared speed, (3, n).
        thrust_per_mass: see specific_thrust().
        most: the greatest moment about each axis, (3,).
    """
    m, state = _as_memory(memory), as_state(estimate)
    if not (all_finite(estimate) and all_finite(speeds)):
        return
    w = rotate(rotation_matrix(state.quaternion).T, state.angular_velocity)
    momentum, dt = inertia * w, state.time - m.time
    if specific_thrust(thrust_per_mass, speeds) < FLYING * GRAVITY:
        assign(moment, np.zeros(3))
        dt = math.inf
    if m.time < 0.0 or dt > _GAP:
        # What was explained so far is such that the moment stays as it is.
        explained = momentum - moment / _GAIN
    else:
        rotors = moments @ (speeds * speeds)
        explained = m.momentum + dt * (rotors - cross(w, momentum) + moment)
        assign(moment, np.minimum(np.maximum(_GAIN * (momentum - explained), -most), most))
    assign(memory, _memory_vector(ObserverMemory(state.time, explained)))
