"""Control of thrust and body rates, as policies and pilots of racing drones command them."""

from typing import Self

from airrace.scenario import Scenario
from airrace.systems.control.rate_law import make_rate_parameters, rate_law
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_vector
from airrace.vehicle import Vehicle, load_vehicle
from airrace.vehicle.state import STATE_SIZE


class RateController(LeafSystem):
    """Turns a total thrust and rates of the body into rotor speeds; see rate_law().

    .. pydrake_system::

        name: RateController
        input_ports:
        - rate_command
        - filtered_estimate
        - rotor_speeds
        output_ports:
        - rotor_speed_command

    ``rate_command``: [f, w_x, w_y, w_z], total thrust (N) and angular velocity in the axes of the
    body (rad/s), (4,); ``filtered_estimate``: a vehicle.State (14), of which attitude and angular
    velocity are used; ``rotor_speeds`` as measured, and ``rotor_speed_command``, held over the
    period: one speed a rotor (rad/s). While an input is not finite, the last command is held.
    """

    def __init__(self, *, vehicle: Vehicle, rate: float):
        """Args: vehicle: inertia and rotors. rate: of the control loop (Hz)."""
        LeafSystem.__init__(self)
        n = len(vehicle.rotors)
        self._parameters = tuple(make_rate_parameters(vehicle, rate))
        self._wanted = self.DeclareVectorInputPort("rate_command", 4)
        self._estimate = self.DeclareVectorInputPort("filtered_estimate", STATE_SIZE)
        self._speeds = self.DeclareVectorInputPort("rotor_speeds", n)
        state = self.DeclareDiscreteState(n)
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / rate, 0.0, self._update_command)
        self.DeclareStateOutputPort("rotor_speed_command", state)

    @classmethod
    def from_scenario(cls, scenario: Scenario) -> Self:
        """Returns the controller of a scenario."""
        return cls(vehicle=load_vehicle(scenario.drone)[0], rate=scenario.controller.rate)

    def _update_command(self, context, discrete_state):
        rate_law(
            discrete_state.get_mutable_value(),
            read_vector(self._wanted, context),
            read_vector(self._estimate, context),
            read_vector(self._speeds, context),
            self._parameters,
        )
