"""From markers to a map of the gates. It flies as it is."""

from airrace.systems.mapping.gate_mapper import GateMapper


class MyMapper(GateMapper):
    """The shipped mapper, to begin with.

    `detections` is of a picture of the past: the mapper looks up where the drone was then.

    .. pydrake_system::

        name: MyMapper
        input_ports:
        - detections
        - camera_info
        - filtered_estimate
        output_ports:
        - gate_map
    """

    def _calc_map(self, context, output):
        """Writes the GateMap; for instance, without gates that were seen too rarely."""
        GateMapper._calc_map(self, context, output)


def make(scenario):
    """Returns the system; called once before a race."""
    return MyMapper.from_scenario(scenario)
