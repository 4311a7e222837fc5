"""Geometric tracking control on SE(3)."""

import functools
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from airrace.common.jit import all_finite, assign, compiled
from airrace.systems.contract import check_arguments, name_of
from airrace.systems.control.control_law import (
    as_parameters,
    lee_wrench,
    make_parameters,
    parameters_vector,
)
from airrace.systems.control.own_wrench import OwnWrench
from airrace.systems.control.rates_of_wrench import set_rates
from airrace.systems.control.reduced_attitude import ReducedAttitude
from airrace.systems.control.rotor_commands import overdrive_of, set_speeds
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_or, read_vector
from airrace.trajopt.reference import REFERENCE_SIZE, as_reference
from airrace.vehicle import Vehicle, load_vehicle
from airrace.vehicle.air import AIR_SIZE, STILL_VECTOR, as_air, drag_rate
from airrace.vehicle.allocation import by_inverse
from airrace.vehicle.rotor_loss import Remaining
from airrace.vehicle.state import STATE_SIZE, as_state

if TYPE_CHECKING:  # else an edit of it would have all machine code compiled anew
    from airrace.scenario import Scenario

_NONE = np.zeros(3)  # no disturbance, and no motion


class GeometricController(LeafSystem):
    """Lee, Leok, McClamroch: Geometric tracking control of a quadrotor UAV on
    SE(3), CDC 2010, with the paper's feed-forward.

    .. pydrake_system::

        name: GeometricController
        input_ports:
        - reference
        - filtered_estimate
        - disturbance
        - disturbance_moment (may be left open: there is none)
        - rotor_speeds
        - rotor_factors (may be left open: rotors are as in the drone's file)
        - rotor_losses
        - air (may be left open: it is not known)
        output_ports:
        - rotor_speed_command
        - rate_command (for a flight controller)

    ``reference``: a trajopt.Reference (18); ``filtered_estimate``: a vehicle.State
    (14); ``disturbance``: an acceleration to lean against (m/s^2,
    in the world), see StateFilter; ``disturbance_moment``: likewise a moment
    (N m, in B), see MomentObserver; ``rotor_speeds`` as measured, and
    ``rotor_speed_command``, held over the period: one speed a rotor (rad/s);
    ``rotor_factors``: see RotorLearner; ``rotor_losses``: see RotorMonitor; ``air``: see
    AirLearner. ``rate_command``, for a flight controller that makes rotor
    speeds of it: [f, w_x, w_y, w_z], thrust (N) and rates in B (rad/s), (4,), see set_rates().

    The desired angular velocity and acceleration come from the jerk and snap
    of the reference; the derivatives of the feedback terms, which would need
    the acceleration of the drone, are left out. Commands of rotor
    speeds overshoot, so that the rotors reach the desired speeds sooner. The
    system of the Student AirRace paper had neither, and other gains; the
    constructor's arguments give its law.

    With rotors lost, the wrench is allocated to the rest. If those cannot hold
    the yaw, the controller ignores the reference and descends: see ReducedAttitude.
    While an input is not finite, the last command is held.

    A class of one's own that has a calc_wrench() has an output ``negative_thrusts`` (1), too: how
    often that asked for a negative thrust, see OwnWrench.
    """

    def __init__(
        self,
        *,
        vehicle: Vehicle,
        rate: float,
        feed_forward: bool = True,
        disturbance_rejection: bool = True,
        attitude_error: str = "reduced",
        gains: str = "vehicle",
        rotor_overdrive: bool = True,
        commands_rates: bool = False,
    ):
        """Constructs the controller.

        Args:
            vehicle: mass, inertia, rotors and gains.
            rate: of the control loop (Hz).
            feed_forward: whether to use the reference's jerk, snap, and yaw
                rates; without, the desired angular velocity and acceleration
                are zero, as in the original system.
            disturbance_rejection: whether to lean against the disturbance and its moment,
                and to count with what was learnt of rotors and air.
            attitude_error: "reduced", the tilt before the yaw, or "lee", the
                paper's law; see lee_wrench().
            gains: "vehicle", or "original" for the original system's, the vehicle's
                original_gains. A drone that cannot hold its yaw descends with "vehicle".
            rotor_overdrive: whether commands overshoot; without, the commanded
                speeds are the desired ones.
            commands_rates: whether a flight controller is told thrust and rates.

        Raises:
            UserError: if the vehicle lacks the gains, or a calc_wrench() of one's own takes other
                arguments.
        """
        LeafSystem.__init__(self)
        n = len(vehicle.rotors)
        self._feed_forward = feed_forward
        self._rejects = disturbance_rejection
        # One vector is quicker to hand over, see common/jit.py.
        parameters = make_parameters(vehicle, attitude_error, gains)
        self._parameters = parameters_vector(parameters)
        self._inertia, self._rate_gains = parameters.inertia, parameters.k_w

        @functools.lru_cache(maxsize=64)
        def known(losses, factors):
            there = vehicle.with_thrusts(np.frombuffer(factors))
            return (
                Remaining(there, np.isinf(np.frombuffer(losses))),
                parameters_vector(make_parameters(there, attitude_error, gains)),
                there.thrust_coefficients,
            )

        self._known = known
        self._as_in_file = np.ones(n).tobytes()
        self._max_speeds = vehicle.max_speeds
        self._overdrive = overdrive_of(vehicle, rate) if rotor_overdrive else 1.0
        self._reduced = ReducedAttitude(vehicle)
        self._reference = self.DeclareVectorInputPort("reference", REFERENCE_SIZE)
        self._estimate = self.DeclareVectorInputPort("filtered_estimate", STATE_SIZE)
        self._disturbance = self.DeclareVectorInputPort("disturbance", 3)
        self._moment = self.DeclareVectorInputPort("disturbance_moment", 3)
        self._speeds = self.DeclareVectorInputPort("rotor_speeds", n)
        self._factors = self.DeclareVectorInputPort("rotor_factors", n)
        self._losses = self.DeclareVectorInputPort("rotor_losses", n)
        self._air = self.DeclareVectorInputPort("air", AIR_SIZE)
        state = self.DeclareDiscreteState(n)
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / rate, 0.0, self._update_command)
        self.DeclareStateOutputPort("rotor_speed_command", state)
        self._rates: int | None = None  # a state, of what a flight controller is told
        if commands_rates:
            rates = self.DeclareDiscreteState(4)
            self.DeclareStateOutputPort("rate_command", rates)
            self._rates = int(rates)
        self._own: OwnWrench | None = None
        if type(self).calc_wrench is not GeometricController.calc_wrench:
            check_arguments(self.calc_wrench, "reference", "estimate")
            clips = self.DeclareDiscreteState(1)
            self.DeclareStateOutputPort("negative_thrusts", clips)
            self._own = OwnWrench(f"{name_of(self)}.calc_wrench()", clips)

    @classmethod
    def from_scenario(cls, scenario: "Scenario") -> Self:
        """Returns the controller of a scenario."""
        options = vars(scenario.controller)
        if scenario.flight_controller != "internal":
            options = options | {"commands_rates": True}
        return cls(vehicle=load_vehicle(scenario.drone)[0], **options)

    def _update_command(self, context, discrete_state):
        losses = read_vector(self._losses, context).tobytes()
        factors = self._as_in_file
        if self._rejects and self._factors.HasValue(context):
            factors = read_vector(self._factors, context).tobytes()
        # Whether it can fly is not asked of what was learnt: that changes in flight.
        can_fly = self._known(losses, self._as_in_file)[0].can_fly
        remaining, parameters, coefficients = self._known(
            losses, factors if can_fly else self._as_in_file
        )
        estimate = read_vector(self._estimate, context)
        disturbance, moment, air = _NONE, _NONE, STILL_VECTOR
        if self._rejects:
            disturbance = read_vector(self._disturbance, context)
            moment = read_or(_NONE, self._moment, context)
            air = read_or(STILL_VECTOR, self._air, context)
        if can_fly:
            reference = self._reference.Eval(context)
            _lean(reference, disturbance, self._feed_forward, air)
            if self._own is None:
                wrench = _wrench(reference, estimate, parameters)
            else:
                wrench = self.calc_wrench(reference, estimate)
                wrench = self._own.checked(wrench, reference, estimate, discrete_state)
        elif all_finite(estimate) and all_finite(disturbance):
            wrench, moment = self._reduced.wrench(estimate, disturbance, remaining), _NONE
        else:
            return
        if self._rates is not None and all_finite(wrench):
            rates = discrete_state.get_mutable_value(self._rates)
            set_rates(rates, wrench, estimate, self._inertia, self._rate_gains)
        wrench = wrench - np.array((0.0, *moment))
        allocator, command = remaining.allocator, discrete_state.get_mutable_value()
        rotors = (
            read_vector(self._speeds, context),
            remaining.max_thrusts,
            coefficients,
            self._max_speeds,
            self._overdrive,
        )
        if allocator.is_complete and _set_by_inverse(command, wrench, allocator.inverse, *rotors):
            return  # no rotor is at a limit, as nearly always
        if all_finite(wrench):
            set_speeds(command, allocator.allocate(wrench), *rotors)

    def calc_wrench(self, reference: np.ndarray, estimate: np.ndarray) -> np.ndarray:
        """Returns total thrust (N) and moments in B (N m), [f, Mx, My, Mz], (4,).

        The result is NaN where an argument is not finite: then the last command is held. A class of
        one's own may return any four numbers, see OwnWrench.

        Args:
            reference: vector of a Reference, (18,), that leans against the disturbance.
            estimate: vector of a State, (14,).
        """
        return _wrench(reference, estimate, self._parameters)


@compiled
def _lean(reference, disturbance, feed_forward, air):
    """Makes a reference, (18,), lean against a disturbance (m/s^2), (3,); see GeometricController.

    The drag of the air, vector of an Air, (7,), changes as the velocity does.
    """
    _, velocity, acceleration, jerk, snap, _, _, _ = as_reference(reference)
    jerk -= drag_rate(velocity, acceleration, as_air(air))
    acceleration -= disturbance
    if not feed_forward:
        assign(jerk, _NONE)
        assign(snap, _NONE)
        assign(reference[-2:], _NONE)  # the derivatives of yaw


@compiled
def _wrench(reference, estimate, parameters):
    if not (all_finite(reference) and all_finite(estimate)):
        return np.full(4, np.nan)
    return lee_wrench(as_reference(reference), as_state(estimate), as_parameters(parameters))


@compiled
def _set_by_inverse(
    command: np.ndarray,
    wrench: np.ndarray,
    inverse: np.ndarray,
    speeds: np.ndarray,
    max_thrusts: np.ndarray,
    *rotors: Any,
) -> bool:
    """Sets the speeds for a wrench by the pseudo-inverse; returns whether the limits allow it."""
    thrusts, possible = by_inverse(inverse, wrench, max_thrusts)
    if possible:
        set_speeds(command, thrusts, speeds, max_thrusts, *rotors)
    return possible
