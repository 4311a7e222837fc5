"""Who of two controllers is heard by the rotors."""

from typing import Self

from airrace.scenario import Scenario
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_vector
from airrace.vehicle import load_vehicle


class CommandSwitch(LeafSystem):
    """Passes the command of the planner's controller on, or that of the network's.

    .. pydrake_system::

        name: CommandSwitch
        input_ports:
        - planned_command
        - policy_command
        - policy_flies
        output_ports:
        - rotor_speed_command

    ``planned_command`` is the GeometricController's, ``policy_command`` the RateController's: one
    speed a rotor (rad/s); ``policy_flies``, of the PolicyController, is 1 if the second counts.
    """

    def __init__(self, *, rotors: int):
        """Args: rotors: how many there are."""
        LeafSystem.__init__(self)
        self._planned = self.DeclareVectorInputPort("planned_command", rotors)
        self._learned = self.DeclareVectorInputPort("policy_command", rotors)
        self._flies = self.DeclareVectorInputPort("policy_flies", 1)
        self.DeclareVectorOutputPort("rotor_speed_command", rotors, self._calc_command)

    @classmethod
    def from_scenario(cls, scenario: Scenario) -> Self:
        """Returns the switch of a scenario."""
        return cls(rotors=len(load_vehicle(scenario.drone)[0].rotors))

    def _calc_command(self, context, output):
        flies = read_vector(self._flies, context)[0] > 0.5
        output.set_value(read_vector(self._learned if flies else self._planned, context))
