"""From the reference to rotor speeds. It flies as it is."""

from airrace.systems.control.geometric_controller import GeometricController


class MyController(GeometricController):
    """The shipped controller, to begin with; `airrace new controller NAME` makes a simpler one.

    .. pydrake_system::

        name: MyController
        input_ports:
        - reference
        - filtered_estimate
        - disturbance
        - rotor_speeds
        - rotor_losses
        output_ports:
        - rotor_speed_command
    """

    def calc_wrench(self, reference, estimate):
        """Returns total thrust (N) and moments about the body's axes (N m), (4,).

        Args:
            reference: vector of a Reference, (18,): where the drone should be.
            estimate: vector of a State, (14,): where it is.
        """
        return super().calc_wrench(reference, estimate)


def make(scenario):
    """Returns the system; called once before a race."""
    return MyController.from_scenario(scenario)
